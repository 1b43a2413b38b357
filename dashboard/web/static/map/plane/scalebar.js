/** Lengths of the scale bar: a round number that is not too long. */

const MAX_PX = 120;
const UNITS = { metric: [[1000, "km"], [1, "m"]], imperial: [[1609.344, "mi"], [0.3048, "ft"]] };

/** @param {number} scale  px a metre @param {string} units  metric or imperial @returns {{width: number, text: string}} width in px */
export function scaleBar(scale, units) {
  const most = MAX_PX / scale;
  const [size, unit] = UNITS[units].find(([metres]) => most >= metres) ?? UNITS[units][1];
  const power = 10 ** Math.floor(Math.log10(most / size));
  const number = [5, 2, 1].find((digit) => digit * power * size <= most) * power;
  return { width: number * size * scale, text: `${number} ${unit}` };
}
