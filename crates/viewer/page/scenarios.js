// All scenarios: their pictures or a table, with filters, the progress of a recording, the flown paths, and the runs.

import { choice, element, json } from './dom.js';
import { FlownPaths } from './flown.js';
import { address, note, shown } from './link.js';
import { classes, colourings, legend } from './path-colours.js';
import { Comparison, estimators } from './runs.js';
import { Thumbnails } from './thumbnails.js';
import { onSchemeChange } from './colours.js';
import { brief, count, duration, fixed, plural } from './units.js';

const STATES = {
  planned: 'planned', recording: 'recording', failed: 'failed', damaged: 'damaged',
  recorded: 'no labels', labelled: 'labelled', detected: 'detected',
};
const isRecorded = row => ['recorded', 'labelled', 'detected'].includes(row.state);
const isMissing = row => ['planned', 'recording', 'failed'].includes(row.state);
/** An unfinished folder that nobody changes for this long was probably left behind. */
const QUIET_S = 120;
/** A rate of recording needs this long. */
const LEAST_OBSERVED_S = 30;
const MOST_ROWS = 400;
const FILTERS = ['text', 'weather', 'time', 'side', 'state', 'worst'];

const COLUMNS = [
  ['id', 'Scenario', 'word'], ['weather', 'Weather', 'word'], ['time_of_day', 'Time', 'word'], ['side', 'Side', 'word'],
  ['state', 'State', 'word'], ['ticks', 'Ticks', ''], ['mape_pct', 'MAPE, %', ''], ['worst_pct', 'Worst error, %', ''],
];

/** How far the recording is, in words; empty if all is there. */
export function progressWords(corpus) {
  const all = corpus.scenarios.length;
  const has = state => corpus.scenarios.filter(row => row.state === state).length;
  const parts = [corpus.scenarios.some(isMissing) ? recordedWords(corpus.scenarios) : plural(all, 'scenario')];
  for (const state of ['recording', 'failed', 'damaged']) {
    if (has(state)) parts.push(`${has(state)} ${STATES[state]}`);
  }
  return parts.join(', ');
}

const recordedWords = rows => `${count(rows.filter(isRecorded).length)} of ${plural(rows.length, 'scenario')} recorded`;

/** Whether there is something to look at. */
export const isOpenable = row => (isRecorded(row) || row.state === 'damaged') && row.views.length > 0;

/** Whether something is being recorded, so that it is worth asking again soon. */
export const isUnderWay = corpus => corpus.scenarios.some(row => row.state === 'recording');

/** The page of all scenarios. */
export class Scenarios {
  constructor({ corpus, runs, signal }) {
    this.corpus = corpus;
    this.runs = runs;
    this.signal = signal;
    const asked = shown();
    this.filters = Object.fromEntries(FILTERS.map(name => [name, asked[name] ?? '']));
    this.sort = asked.sort ?? 'id';
    this.judge = asked.judge ?? '';
    this.form = asked.as === 'table' ? 'table' : 'pictures';
    this.colouring = asked.colour ?? 'weather';
    this.showsAll = false;
    this.head = element('div');
    this.filterBar = element('form', { class: 'filters', onsubmit: event => event.preventDefault() });
    this.thumbnails = new Thumbnails(signal);
    this.list = element('div', { onpointerover: event => this.point(event.target.closest('[data-id]')?.dataset.id ?? null),
      onpointerleave: () => this.point(null) });
    this.found = element('p', { class: 'note', role: 'status' });
    this.failures = element('div');
    this.compared = new Comparison();
    this.flown = new FlownPaths({ onpick: id => { location.hash = address({ scenario: id }); }, onpoint: id => this.point(id) });
    this.colourChoice = element('div');
    this.legend = element('ul', { class: 'legend', 'aria-label': 'Colours of the paths' });
    this.flownSaid = element('p', { class: 'note' });
    this.element = element('div', { class: 'overview' },
      element('section', { class: 'top-of-list', 'aria-labelledby': 'title' },
        element('h1', { id: 'title' }, corpus.corpus), this.head, this.compared.element, this.filterBar, this.found),
      element('div', { class: 'list' }, this.list, this.failures),
      element('section', { class: 'beside', 'aria-labelledby': 'flown-title' },
        element('h2', { id: 'flown-title' }, 'Flown paths'),
        element('div', { class: 'layers' }, this.colourChoice, this.legend), this.flown.element, this.flownSaid));
    onSchemeChange(() => this.drawPaths(), signal);
    this.fill();
    this.readPaths();
  }

  /** Shows a newer state of the corpus or of the runs. */
  update(corpus, runs) {
    const isSame = JSON.stringify([this.corpus, this.runs.length]) === JSON.stringify([corpus, runs.length]);
    Object.assign(this, { corpus, runs });
    if (isSame) return;
    this.fill();
    this.readPaths();
  }

  fill() {
    const { corpus } = this;
    this.head.replaceChildren(
      element('p', { class: 'note' }, corpus.folder),
      ...corpus.problems.map(problem => element('p', { class: 'problem' }, problem)),
      this.progress());
    this.fillFilters();
    this.fillColours();
    this.fillList();
    const failed = corpus.scenarios.filter(row => row.faults.length);
    this.failures.replaceChildren(...failed.length ? [
      element('h2', {}, 'What failed, and why'),
      element('ul', { class: 'faults' }, failed.map(row => element('li', {},
        element('strong', {}, row.id), ` (${STATES[row.state]})`,
        element('ul', {}, row.faults.map(fault => element('li', {}, fault)))))),
    ] : []);
    if (this.runs.length) this.compared.show(this.runs, corpus.scenarios);
    else if (corpus.runs.length) this.compared.element.replaceChildren(element('p', { class: 'note' }, 'Reading the predictions ...'));
  }

  progress() {
    const { scenarios } = this.corpus;
    const under = scenarios.filter(row => row.state === 'recording');
    if (!scenarios.some(isMissing)) return element('div');
    const ticks = rows => rows.reduce((sum, row) => sum + (row.ticks ?? 0), 0);
    const done = ticks(scenarios.filter(isRecorded));
    const begun = under.reduce((sum, row) => sum + (row.recorded_ticks ?? 0), 0);
    // A share would mislead where a scenario of unknown length is left out of it.
    const all = scenarios.every(row => row.ticks !== null) ? ticks(scenarios) : 0;
    const bar = all ? element('progress', { max: all, value: done + begun, 'aria-label': 'Recorded ticks' }) : null;
    const now = under.map(row => {
      const recorded = row.recorded_ticks ?? 0;
      // One that the plan does not have may be of any length.
      const far = row.ticks === null ? plural(recorded, 'tick') : `${count(recorded)} of about ${plural(row.ticks, 'tick')}`;
      const quiet = row.unchanged_s > QUIET_S ? `; unchanged for ${duration(row.unchanged_s)}, perhaps interrupted` : '';
      return element('li', {}, element('strong', {}, row.id), `: ${far}${quiet}`);
    });
    return element('div', { class: 'under-way' },
      element('p', {}, recordedWords(scenarios),
        ...all ? [`, ${fixed((done + begun) / all * 100, 1)} % of the ticks`, this.timeLeft(done + begun, all)] : []), bar,
      now.length ? element('ul', {}, now) : null);
  }

  /** In words, from what was recorded since the page was opened. */
  timeLeft(ticks, all) {
    const now_s = performance.now() / 1000;
    this.before ??= { now_s, ticks };
    const [took_s, recorded] = [now_s - this.before.now_s, ticks - this.before.ticks];
    return took_s < LEAST_OBSERVED_S || recorded <= 0 ? '' : `, about ${duration((all - ticks) * took_s / recorded)} left`;
  }

  fillFilters() {
    const { scenarios } = this.corpus;
    const values = key => [...new Set(scenarios.map(row => row[key]).filter(Boolean))].sort();
    const select = (name, key, label, texts = {}) => choice(label,
      [['', 'all'], ...values(key).map(value => [value, texts[value] ?? value])], this.filters[name], value => this.filter(name, value));
    const judges = this.runs.flatMap((run, index) => Object.values(run.flights).length
      ? estimators([run]).map(name => [`${index}:${name}`, this.runs.length > 1 ? `${run.name}: ${name}` : name]) : []);
    if (judges.length && !judges.some(([value]) => value === this.judge)) {
      this.judge = (judges.find(([value]) => value.endsWith(':inverse_range')) ?? judges[0])[0];
    }
    const field = (name, label, attributes) => {
      const input = element('input', { ...attributes, value: this.filters[name], oninput: () => this.filter(name, input.value) });
      return element('label', { class: 'field' }, element('span', {}, label), input);
    };
    if (this.filterBar.contains(document.activeElement) && document.activeElement.tagName === 'INPUT') return;
    this.filterBar.replaceChildren(
      choice('Show', [['pictures', 'images'], ['table', 'table']], this.form, form => {
        this.form = form;
        note({ as: form === 'table' ? form : undefined });
        this.fillFilters();
        this.filterBar.querySelector('select').focus();
        this.fillList();
      }),
      field('text', 'Name contains', { type: 'search', size: 14 }),
      select('weather', 'weather', 'Weather'), select('time', 'time_of_day', 'Time'), select('side', 'side', 'Side'),
      select('state', 'state', 'State', STATES),
      ...judges.length ? [
        choice('Errors of', judges, this.judge, value => {
          this.judge = value;
          note({ judge: value });
          this.fillList();
        }),
        field('worst', 'Worst above, %', { type: 'number', min: 0, step: 'any' }),
      ] : [],
      // Headings sort a table.
      ...this.form === 'pictures' ? [choice('Sort by', this.orders(judges.length > 0), this.sort, sort => {
        this.sort = sort;
        note({ sort });
        this.fillList();
      })] : []);
  }

  fillColours() {
    this.colourings = colourings(this.runs.some(run => Object.values(run.flights).length));
    if (this.colourChoice.contains(document.activeElement)) return;
    this.colourChoice.replaceChildren(choice('Coloured by', this.colourings, this.colouredBy(), value => {
      this.colouring = value;
      note({ colour: value === 'weather' ? undefined : value });
      this.drawPaths();
    }));
  }

  filter(name, value) {
    this.filters[name] = value;
    note({ [name]: value });
    this.fillList();
  }

  /** Rows with their errors, filtered and sorted. */
  rows() {
    const [run, estimator] = [this.runs[this.judge.split(':')[0]], this.judge.slice(this.judge.indexOf(':') + 1)];
    const rows = this.corpus.scenarios.map(row => ({ ...row, ...run?.flights[row.id]?.[estimator] }));
    const { text, weather, time, side, state, worst } = this.filters;
    const isShown = row => (!text || row.id.toLowerCase().includes(text.toLowerCase())) && (!weather || row.weather === weather)
      && (!time || row.time_of_day === time) && (!side || row.side === side) && (!state || row.state === state)
      && (!(worst > 0) || row.worst_pct > Number(worst));
    const [key, isDown] = [this.sort.replace('-', ''), this.sort.startsWith('-')];
    const order = (one, other) => {
      const [a, b] = [one[key] ?? null, other[key] ?? null];
      if (a === b) return one.id < other.id ? -1 : 1;
      if (a === null) return 1;
      if (b === null) return -1;
      return (a < b ? -1 : 1) * (isDown ? -1 : 1);
    };
    return rows.filter(isShown).sort(order);
  }

  orders(hasErrors) {
    const orders = [['id', 'name'], ['weather', 'weather'], ['time_of_day', 'time'], ['side', 'side'], ['state', 'state'],
      ...hasErrors ? [['-worst_pct', 'worst error'], ['-mape_pct', 'largest MAPE'], ['mape_pct', 'smallest MAPE']] : []];
    // Headings of the table sort in further ways.
    return orders.some(([order]) => order === this.sort) ? orders : [...orders, [this.sort, 'as the table']];
  }

  fillList() {
    const rows = this.rows();
    const some = this.showsAll ? rows : rows.slice(0, MOST_ROWS);
    this.list.replaceChildren(this.form === 'table' ? this.table(some) : this.gallery(some),
      ...some.length < rows.length ? [element('button', { type: 'button', onclick: () => {
        this.showsAll = true;
        this.fillList();
      } }, `Show all ${count(rows.length)}`)] : []);
    const all = this.corpus.scenarios.length;
    this.found.textContent = rows.length === all ? plural(all, 'scenario') : `${count(rows.length)} of ${plural(all, 'scenario')}`;
    this.visible = new Map(rows.map(row => [row.id, row]));
    this.flown.shown = id => this.visible.has(id);
    this.drawPaths();
  }

  gallery(rows) {
    const facts = row => [row.weather_differs.length ? `${row.weather} (not as planned)` : row.weather, row.time_of_day, row.side].filter(Boolean).join(' · ');
    return element('ul', { class: 'gallery' }, rows.map(row => {
      const words = row.state === 'recording' && row.recorded_ticks !== null ? `${count(row.recorded_ticks)} of ${count(row.ticks)} ticks` : 'no picture';
      return element('li', { class: 'card', 'data-id': row.id },
        this.thumbnails.of(row, isOpenable(row), words),
        element('p', { class: 'name' }, isOpenable(row) ? element('a', { href: address({ scenario: row.id }) }, row.id) : row.id),
        element('p', { class: 'note' }, facts(row)),
        element('p', { class: 'note' }, element('span', { class: `state ${row.state}` }, STATES[row.state]),
          ...row.mape_pct === undefined ? [] : [' · ', element('span', { class: 'nowrap' }, `MAPE ${brief(row.mape_pct, 3, 10)} %`)]));
    }));
  }

  table(rows) {
    const hasErrors = rows.some(row => row.worst_pct !== undefined);
    const columns = COLUMNS.filter(([key]) => hasErrors || !key.endsWith('_pct'));
    const cell = (row, key) => {
      if (key === 'id') return isOpenable(row) ? element('a', { href: address({ scenario: row.id }) }, row.id) : row.id;
      if (key === 'state') return element('span', { class: `state ${row.state}` }, STATES[row.state]);
      if (key === 'weather' && row.weather_differs.length) {
        return element('span', { class: 'marked', title: row.weather_differs.join('; ') }, `${row.weather} (not as planned)`);
      }
      if (key === 'ticks') {
        return row.state === 'recording' && row.recorded_ticks !== null ? `${count(row.recorded_ticks)} of ${count(row.ticks)}` : count(row.ticks);
      }
      if (key === 'worst_pct' && row.worst_pct !== undefined) {
        const title = `tick ${row.worst_tick}`;
        return element('a', { href: address({ scenario: row.id, tick: row.worst_tick }), title }, fixed(row.worst_pct, 2));
      }
      return key === 'mape_pct' ? fixed(row.mape_pct, 3) : row[key] ?? '–';
    };
    const heading = ([key, title, kind]) => {
      const [is, isDown] = [this.sort.replace('-', '') === key, this.sort.startsWith('-')];
      const turn = () => {
        this.sort = is && !isDown ? `-${key}` : is ? key : key.endsWith('_pct') ? `-${key}` : key;
        note({ sort: this.sort });
        this.fillList();
        this.list.querySelector(`[data-key=${key}]`).focus();
      };
      return element('th', { class: kind, scope: 'col', 'aria-sort': is ? (isDown ? 'descending' : 'ascending') : undefined },
        element('button', { type: 'button', class: 'sort', 'data-key': key, onclick: turn }, title, is ? (isDown ? ' ↓' : ' ↑') : ''));
    };
    return element('div', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': 'Scenarios' }, element('table', { class: 'scenarios' },
      element('thead', {}, element('tr', {}, columns.map(heading))),
      element('tbody', {}, rows.map(row => element('tr', { 'data-id': row.id },
        columns.map(([key, , kind]) => element(key === 'id' ? 'th' : 'td', { class: kind, scope: key === 'id' ? 'row' : undefined }, cell(row, key))))))));
  }

  /** The chosen colours, if there are any of this kind. */
  colouredBy() {
    return this.colourings.some(([value]) => value === this.colouring) ? this.colouring : 'weather';
  }

  /** Draws the paths and their legend in the chosen colours. */
  drawPaths() {
    const rows = [...this.visible.values()];
    const shown = classes(this.colouredBy(), rows.filter(row => this.flown.paths.has(row.id)), this.corpus.scenarios);
    this.flown.style = id => shown.find(one => one.has(this.visible.get(id))).style();
    this.legend.replaceChildren(...legend(shown));
    this.flown.draw();
  }

  /** Marks the path of a scenario, and its row or picture; null marks none. */
  point(id) {
    if (id === this.flown.chosen) return;
    this.flown.chosen = id;
    // Paths may have been read since the last drawing, and have no colour yet.
    this.drawPaths();
    for (const one of this.list.querySelectorAll('[data-id]')) one.classList.toggle('pointed', one.dataset.id === id);
  }

  /** Reads the paths that are not there yet, a few at a time. */
  async readPaths() {
    const missing = this.corpus.scenarios.filter(row => isOpenable(row) && !this.flown.paths.has(row.id)).map(row => row.id);
    const read = async () => {
      while (missing.length && !this.signal.aborted) {
        const id = missing.shift();
        try {
          this.flown.add(id, await json('/api/path', { scenario: id }));
        } catch {
          // Its row says what is wrong with it.
        }
        if (missing.length % 8 === 0) this.sayPaths(missing.length);
      }
    };
    this.sayPaths(missing.length);
    await Promise.all([read(), read()]);
    if (!this.signal.aborted) this.sayPaths(0);
  }

  sayPaths(missing) {
    this.drawPaths();
    this.flownSaid.textContent = missing ? `${plural(missing, 'path')} still to be read`
      : this.flown.paths.size ? 'Click a path to open its scenario. Offset and height are magnified against the distance.' : 'Nothing is recorded yet.';
  }
}
