// Elements. Whatever comes from a corpus becomes text here and never markup.

/** An element with attributes, listeners (`onclick: f`) and children; children that are not elements are text. */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith('on')) made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value === true ? '' : value);
  }
  made.append(...children.flat().filter(child => child !== null && child !== undefined && child !== false));
  return made;
}

/** A select whose options are [value, text] pairs; `change` is told the chosen value. */
export function choice(label, options, chosen, change) {
  const select = element('select', { 'aria-label': label, onchange: () => change(select.value) },
    options.map(([value, text]) => element('option', { value, selected: value === chosen }, text)));
  return element('label', { class: 'field' }, element('span', {}, label), select);
}

/** A check box with a label; `change` is told whether it is checked. */
export function check(label, checked, change, ...before) {
  const box = element('input', { type: 'checkbox', checked, onchange: () => change(box.checked) });
  return element('label', { class: 'check' }, box, ...before, label);
}

/** What can go wrong with a request, as text. */
export class RequestError extends Error {}

/** The JSON at an address of this page. */
export async function json(address, parameters = {}) {
  const query = new URLSearchParams(parameters).toString();
  let response;
  try {
    response = await fetch(query ? `${address}?${query}` : address);
  } catch {
    throw new RequestError('dtd view does not answer; was it stopped?');
  }
  const answer = await response.json().catch(() => ({ error: `${address} answered ${response.status}` }));
  if (!response.ok) throw new RequestError(answer.error ?? `${address} answered ${response.status}`);
  return answer;
}
