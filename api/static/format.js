/** Numbers and names as a person reads them. */

/** A length with the unit that suits it: 0.045 mm, 41 mm, 1.24 m. */
export function length(metres) {
  const size = Math.abs(metres);
  if (size >= 1e5) return ["none near", ""];
  if (size >= 1) return [metres.toFixed(2), "m"];
  if (size >= 1e-2) return [(metres * 1e3).toFixed(0), "mm"];
  return [(metres * 1e3).toFixed(3), "mm"];
}

/** Four significant digits at most, never exponents for what is nearly nothing. */
export function short(value) {
  if (!Number.isFinite(value)) return "–";
  if (Math.abs(value) < 5e-4) return "0";
  return String(Number(value.toPrecision(4))).replace("-", "−");
}

/** Fixed decimals and a true minus, so that figures keep their width. */
export function fixed(value, decimals) {
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? (0).toFixed(decimals) : text.replace("-", "−");
}

/** "front_left" → "front left". */
export function words(name) {
  return name.replaceAll("_", " ");
}

/** "wheel_radius" → "Wheel radius". */
export function label(name) {
  const text = words(name);
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** "rad/s^2" → "rad/s²". */
export function unit(text) {
  return text.replaceAll("^2", "²").replaceAll("^3", "³");
}

export function degrees(angle) {
  return Math.round((angle * 180) / Math.PI);
}
