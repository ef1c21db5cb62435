// What is shown, in the part of the address after #: a copied link shows the same again.

/** What the address asks for, by name. */
export function shown() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

/** The address of this page that shows something. Undefined and empty values are left out. */
export function address(values) {
  const given = Object.entries(values).filter(([, value]) => value !== undefined && value !== null && value !== '');
  return `#${new URLSearchParams(given)}`;
}

let later;
let changes = {};

/** Changes the address soon, without a new entry in the history: browsers limit how often that may be done. */
export function note(values) {
  Object.assign(changes, values);
  later ??= setTimeout(write, 250);
}

/** Changes the address now, before another page is shown. */
export function settle() {
  if (later !== undefined) write();
}

function write() {
  clearTimeout(later);
  later = undefined;
  history.replaceState(null, '', address({ ...shown(), ...changes }));
  changes = {};
}

/** Drops what would still be noted: another page is about to be shown. */
export function forget() {
  clearTimeout(later);
  later = undefined;
  changes = {};
}
