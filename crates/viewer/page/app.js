// The page: which part is shown, and what is asked of the server.

import { element, json } from './dom.js';
import { forget, shown } from './link.js';
import { ScenarioPage } from './scenario.js';
import { Scenarios, isUnderWay, progressWords } from './scenarios.js';

const SOON_MS = 2000;
const LATER_MS = 15000;

const main = document.getElementById('main');
const keys = document.getElementById('keys');
let corpus = null;
let runs = [];
let page = null;
let leave = new AbortController();

function fail(error) {
  main.replaceChildren(element('div', { class: 'narrow' }, element('p', { class: 'problem', role: 'alert' }, error.message),
    element('p', {}, element('a', { href: '#' }, 'All scenarios'))));
}

async function show() {
  forget();
  leave.abort();
  leave = new AbortController();
  const { signal } = leave;
  const { scenario } = shown();
  try {
    if (scenario) {
      document.title = `${scenario} – dtd view`;
      main.replaceChildren(element('p', { class: 'note narrow', role: 'status' }, `Opening ${scenario} ...`));
      const tables = await json('/api/scenario', { scenario });
      if (signal.aborted) return;
      page = new ScenarioPage({ corpus, tables, signal });
    } else {
      document.title = `${corpus.corpus} – dtd view`;
      page = new Scenarios({ corpus, runs, signal });
    }
    main.replaceChildren(page.element);
    page.begin?.();
  } catch (error) {
    if (!signal.aborted) fail(error);
  }
}

async function refresh() {
  try {
    corpus = await json('/api/corpus');
    document.getElementById('corpus').textContent = corpus.corpus;
    document.getElementById('progress').textContent = progressWords(corpus);
    if (page instanceof Scenarios && !leave.signal.aborted) page.update(corpus, runs);
  } catch (error) {
    document.getElementById('progress').textContent = error.message;
    if (!corpus) throw error;
  }
  setTimeout(refresh, isUnderWay(corpus) ? SOON_MS : LATER_MS);
}

async function begin() {
  try {
    await refresh();
  } catch (error) {
    fail(error);
    return;
  }
  addEventListener('hashchange', show);
  show();
  if (corpus.runs.length) {
    runs = await json('/api/runs').catch(() => []);
    if (page instanceof Scenarios) page.update(corpus, runs);
  }
}

document.getElementById('show-keys').addEventListener('click', () => keys.showModal());
addEventListener('keydown', event => {
  if (event.key === '?' && !event.target.matches('input')) keys.showModal();
});
begin();
