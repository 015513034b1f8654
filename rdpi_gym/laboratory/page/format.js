// Numbers as a reader wants them: three digits that count, and their unit.

/** A number with so many significant digits and no exponent where that can be read. */
export function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(Number(value.toPrecision(digits)));
  if (size >= 1e6 || size < 1e-4) {
    const [mantissa, power] = value.toExponential(digits - 1).split("e");
    return `${mantissa.replace("-", "−")}·10${superscript(Number(power))}`;
  }
  const places = Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
  return grouped(value.toFixed(Math.min(places, 8)));
}

const superscript = (power) => String(power).replace(/./g, (c) => ({"-": "⁻"}[c] ?? "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]));

function grouped(text) {
  const [whole, part] = text.replace("-", "−").split(".");
  const parted = whole.replace(/\B(?=(\d{3})+(?!\d))/g, ",");
  return part === undefined ? parted : `${parted}.${part}`;
}

export const whole = (value) => grouped(String(Math.round(value)));
export const withUnit = (value, unit, digits = 3) => `${number(value, digits)}${unit ? ` ${unit}` : ""}`;
export const percent = (share) => (share === null || share === undefined ? "–" : `${Math.round(100 * share)} %`);

/** A time in the unit that needs the fewest digits. */
export function time(seconds, digits = 3) {
  if (seconds === null || seconds === undefined) return "–";
  const size = Math.abs(seconds);
  if (size > 0 && size < 9.9995e-4) return withUnit(seconds * 1e6, "µs", digits);
  if (size > 0 && size < 0.99995) return withUnit(seconds * 1e3, "ms", digits);
  return withUnit(seconds, "s", digits);
}

export const count = (n, one, many = `${one}s`) => `${whole(n)} ${n === 1 ? one : many}`;

/** A number for a field that is typed into: as exact as it needs to be, without groups. */
export const typed = (value, digits = 6) => (Number.isFinite(value) ? String(Number(value.toPrecision(digits))) : "");
