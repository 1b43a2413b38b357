/** Vehicles' signs, drawn once for each colour: a thousand pictures are drawn faster than as many shapes. */

/** Side of a sign's cell, px. */
const CELL = 40;
/** Corners of an arrow that points north, and of a disc's nose, px. */
const ARROW = [[0, -9], [6, 6.5], [0, 3], [-6, 6.5]];
const NOSE = [[0, -16.5], [5, -10.5], [-5, -10.5]];

/** Shapes around the origin, in the order of the sheet's columns: each twice, filled and hollow. */
const SHAPES = {
  dot: circle(3.4),
  smallDot: circle(2.6),
  rest: circle(5),
  square: () => {
    const path = new Path2D();
    path.roundRect(-6, -6, 12, 12, 3);
    return path;
  },
  arrow: () => polygon(ARROW),
  disc: circle(11),
  pointedDisc: () => {
    const path = circle(11)();
    path.addPath(polygon(NOSE));
    return path;
  },
};

/** Half the side of the square around each shape and its border, px. */
const HALVES = { dot: 6, smallDot: 5, rest: 9, square: 9, arrow: 12, disc: 14, pointedDisc: 19 };

/** @typedef {keyof typeof SHAPES} Shape */

const COLUMNS = /** @type {Shape[]} */ (Object.keys(SHAPES));
/** @type {WeakMap<object, {scale: number, sheet: HTMLCanvasElement}>} by palette */
const sheets = new WeakMap();

/**
 * A function that draws a vehicle's sign.
 * @param {CanvasRenderingContext2D} context
 * @param {any} palette
 * @returns {(shape: Shape, colour: number, isFilled: boolean, x: number, y: number, heading: number)
 *   => void}  px and degrees clockwise from north
 */
export function stamp(context, palette) {
  const base = context.getTransform();
  // Signs are turned and lie between pixels: from a sheet of twice their size they stay sharp.
  const scale = Math.max(2, Math.ceil(base.a));
  let kept = sheets.get(palette);
  if (kept?.scale !== scale) {
    kept = { scale, sheet: drawSheet(palette, scale) };
    sheets.set(palette, kept);
  }
  const { sheet } = kept;
  return (shape, colour, isFilled, x, y, heading) => {
    const column = 2 * COLUMNS.indexOf(shape) + (isFilled ? 0 : 1);
    // No more than the sign itself: copying empty pixels costs as much.
    const half = HALVES[shape];
    const left = ((column + 0.5) * CELL - half) * scale;
    const top = ((colour + 0.5) * CELL - half) * scale;
    const side = 2 * half * scale;
    if (heading) {
      const sin = Math.sin((heading * Math.PI) / 180);
      const cos = Math.cos((heading * Math.PI) / 180);
      context.setTransform(
        base.a * cos, base.a * sin, -base.a * sin, base.a * cos, base.a * x + base.e, base.a * y + base.f,
      );
      context.drawImage(sheet, left, top, side, side, -half, -half, 2 * half, 2 * half);
      context.setTransform(base);
    } else {
      context.drawImage(sheet, left, top, side, side, x - half, y - half, 2 * half, 2 * half);
    }
  };
}

function drawSheet(palette, scale) {
  const sheet = document.createElement("canvas");
  sheet.width = 2 * COLUMNS.length * CELL * scale;
  sheet.height = palette.vehicles.length * CELL * scale;
  const context = sheet.getContext("2d");
  context.lineJoin = "round";
  palette.vehicles.forEach((colour, row) => {
    COLUMNS.forEach((shape, column) => {
      const path = SHAPES[shape]();
      const isSmall = shape === "dot" || shape === "smallDot";
      for (const isHollow of [0, 1]) {
        const [x, y] = [2 * column + isHollow + 0.5, row + 0.5].map((cell) => cell * CELL * scale);
        context.setTransform(scale, 0, 0, scale, x, y);
        context.strokeStyle = palette.halo;
        context.lineWidth = isSmall ? 2.4 : isHollow ? 5 : 3.6;
        context.stroke(path);
        context.fillStyle = isHollow ? palette.halo : colour;
        context.fill(path);
        if (!isHollow) continue;
        context.strokeStyle = colour;
        context.lineWidth = isSmall ? 1.5 : 2;
        context.stroke(path);
        // Inner edges of a shape of two parts.
        if (shape === "pointedDisc") context.fill(circle(10)());
      }
    });
  });
  return sheet;
}

function circle(radius) {
  return () => {
    const path = new Path2D();
    path.arc(0, 0, radius, 0, 2 * Math.PI);
    return path;
  };
}

function polygon(corners) {
  const path = new Path2D();
  for (const [x, y] of corners) path.lineTo(x, y);
  path.closePath();
  return path;
}
