// Numbers with their units.

export const METRES_PER_NM = 1852;
const KNOTS_PER_MPS = 3600 / METRES_PER_NM;

/** The number with this many decimals, or a dash if it is missing. */
export function fixed(value, decimals) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  const text = value.toFixed(decimals);
  // What rounds to zero has no sign.
  return text.replace('-', Number(text) === 0 ? '' : '−');
}

/** The same, but without decimals from `limit` on: columns have no room for what nobody reads. */
export const brief = (value, decimals, limit) => fixed(value, Math.abs(value) < limit ? decimals : 0);

export const count = value => value === null || value === undefined ? '–' : value.toLocaleString('en');
export const plural = (number, thing) => `${count(number)} ${thing}${number === 1 ? '' : 's'}`;
export const metres = value => `${fixed(value, Math.abs(value) < 1000 ? 1 : 0)} m`;
export const nauticalMiles = metres => `${fixed(metres / METRES_PER_NM, 3)} NM`;
export const seconds = value => `${fixed(value, 2)} s`;
export const speed = mps => `${fixed(mps, 1)} m/s (${fixed(mps * KNOTS_PER_MPS, 0)} kt)`;

/** A duration in words: "3 min 20 s". */
export function duration(total_s) {
  const [hours, minutes] = [Math.floor(total_s / 3600), Math.floor(total_s / 60) % 60];
  if (hours > 0) return `${hours} h ${minutes} min`;
  return minutes > 0 ? `${minutes} min ${Math.floor(total_s % 60)} s` : `${Math.floor(total_s)} s`;
}
