/** Numbers for people: fixed places, so that nothing jumps, and the units of the scene file. */

/** What stands where there is no value. */
export const NONE = "–";

/**
 * A number with fixed decimals and a true minus sign.
 * @param {?number} value
 * @param {number} decimals
 */
export function fixed(value, decimals) {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE;
  const text = value.toFixed(decimals);
  // -0.00 is 0.00
  return Number(text) === 0 ? (0).toFixed(decimals) : text.replace("-", "−");
}

/** A number with about three significant figures, for labels and fields. @type {(value: number) => string} */
export function short(value) {
  if (!Number.isFinite(value)) return NONE;
  if (value === 0) return "0";
  const decimals = Math.max(0, 2 - Math.floor(Math.log10(Math.abs(value))));
  return String(Number(value.toFixed(Math.min(decimals, 8))));
}

/** A length with the unit that fits it. @type {(metres: number) => string} */
export function lengthText(metres) {
  if (metres >= 1) return `${short(metres)} m`;
  if (metres >= 1e-3) return `${short(metres * 1e3)} mm`;
  return `${short(metres * 1e6)} µm`;
}

/** An area with the unit that fits it. @type {(m2: number) => string} */
export const areaText = (m2) => (m2 >= 1 ? `${grouped(m2)} m²` : `${grouped(m2 * 1e6)} mm²`);

/** A volume with the unit that fits it. @type {(m3: number) => string} */
export const volumeText = (m3) => (m3 >= 1e-3 ? `${grouped(m3)} m³` : `${grouped(m3 * 1e9)} mm³`);

/** About three significant figures, or all before the point. */
const grouped = (value) => (value >= 999.5 ? count(Math.round(value)) : short(value));

/** A count with thin spaces between thousands. @type {(n: number) => string} */
export const count = (n) => String(n).replace(/\B(?=(\d{3})+$)/g, "\u202f");

/**
 * How a parameter is shown: the words and the unit of the scene file, `shown = value × factor`.
 * @typedef {{label: string, unit: string, factor: number}} Words
 * @type {Object<string, Words>}
 */
const PARAMETERS = {
  contact_stiffness_n_per_m: { label: "Contact stiffness", unit: "N/mm", factor: 1e-3 },
  contact_damping_ratio: { label: "Contact damping ratio", unit: "", factor: 1 },
  friction_static: { label: "Static friction", unit: "", factor: 1 },
  friction_dynamic: { label: "Dynamic friction", unit: "", factor: 1 },
  filter_cutoff_low_hz: { label: "Filter cut-off, low", unit: "Hz", factor: 1 },
  filter_cutoff_high_hz: { label: "Filter cut-off, high", unit: "Hz", factor: 1 },
  coupling_stiffness_n_per_m: { label: "Coupling, translation", unit: "N/mm", factor: 1e-3 },
  coupling_stiffness_nm_per_rad: { label: "Coupling, rotation", unit: "N·m/rad", factor: 1 },
  limit_force_n: { label: "Force limit", unit: "N", factor: 1 },
  clay_brush_m: { label: "Brush radius", unit: "mm", factor: 1e3 },
  clay_depth_m: { label: "Depth of the image", unit: "mm", factor: 1e3 },
  limit_torque_nm: { label: "Torque limit", unit: "N·m", factor: 1 },
};

/** Words for a parameter; one that this page does not know keeps its name. @type {(name: string) => Words} */
export const parameterWords = (name) => PARAMETERS[name] ?? { label: name.replaceAll("_", " "), unit: "", factor: 1 };
