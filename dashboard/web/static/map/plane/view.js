/** The part of the plane that is seen: its middle, its scale, its size on the screen. */

const MAX_SCALE = 8;

/** Metres east and north to pixels right and down, and back. */
export class View {
  constructor() {
    this.x = 0;
    this.y = 0;
    /** Pixels a metre. */
    this.scale = 1;
    this.width = 1;
    this.height = 1;
    this.minScale = 1e-4;
  }

  /** @param {number} x  m */
  px(x) {
    return (x - this.x) * this.scale + this.width / 2;
  }

  /** @param {number} y  m */
  py(y) {
    return (this.y - y) * this.scale + this.height / 2;
  }

  /** @param {number} px */
  mx(px) {
    return (px - this.width / 2) / this.scale + this.x;
  }

  /** @param {number} py */
  my(py) {
    return (this.height / 2 - py) / this.scale + this.y;
  }

  /** What is seen, and a strip around it: x0, y0, x1, y1, m. @param {number} [strip] px @returns {[number, number, number, number]} */
  bounds(strip = 0) {
    return [
      this.mx(-strip), this.my(this.height + strip), this.mx(this.width + strip), this.my(-strip),
    ];
  }

  /** The same middle and scale, with a margin on all sides. @param {number} margin px */
  widened(margin) {
    const wide = Object.assign(new View(), this);
    wide.width += 2 * margin;
    wide.height += 2 * margin;
    return wide;
  }

  /**
   * The view of a box that fills the screen but for a margin.
   * @param {[number, number, number, number]} bounds  m
   * @param {number|{right: number, bottom: number}} [margin]  px; of 32 where only two sides are given
   */
  fitted(bounds, margin = 32) {
    const [edge, right, bottom] = typeof margin === "number" ? [margin, margin, margin] : [32, margin.right, margin.bottom];
    const view = Object.assign(new View(), this);
    const wide = Math.max(bounds[2] - bounds[0], 50);
    const high = Math.max(bounds[3] - bounds[1], 50);
    const across = Math.max(this.width - edge - right, 20) / wide;
    const down = Math.max(this.height - edge - bottom, 20) / high;
    view.scale = Math.min(MAX_SCALE, across, down);
    view.x = (bounds[0] + bounds[2]) / 2 + (right - edge) / 2 / view.scale;
    view.y = (bounds[1] + bounds[3]) / 2 - (bottom - edge) / 2 / view.scale;
    return view;
  }

  /** @param {number} scale */
  clamped(scale) {
    return Math.max(this.minScale, Math.min(MAX_SCALE, scale));
  }

  /** Zoom so that what lies under a pixel stays there. @param {number} factor  more than 1: nearer @param {number} px @param {number} py */
  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const x = this.mx(px);
    const y = this.my(py);
    this.scale = this.clamped(this.scale * factor);
    this.x = x - (px - this.width / 2) / this.scale;
    this.y = y + (py - this.height / 2) / this.scale;
  }

  /** Move what is seen by pixels. @param {number} right @param {number} down */
  pan(right, down) {
    this.x -= right / this.scale;
    this.y += down / this.scale;
  }

  /** A line in metres as one in pixels. @param {number[]} line */
  project(line) {
    const projected = new Array(line.length);
    for (let i = 0; i < line.length; i += 2) {
      projected[i] = this.px(line[i]);
      projected[i + 1] = this.py(line[i + 1]);
    }
    return projected;
  }
}
