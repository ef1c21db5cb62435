// The runs beside each other: a row for each estimator, and how much a run differs from the first one.

import { choice, element } from './dom.js';
import { fixed } from './units.js';

const FIGURES = [
  ['mape_pct', 'MAPE, %', 3], ['median_pct', 'median, %', 3], ['p95_pct', '95 % in %', 3], ['p95_m', '95 % in m', 1], ['coverage', 'coverage, %', 1],
];
/** Resamples, and the share of them inside an interval, as in an evaluation's rules. */
const RESAMPLES = 1000;
const SHARE = 0.9;

/** All names of estimators: the recommended one, then those of the first run. */
export function estimators(runs) {
  const names = new Set(runs.flatMap(run => [
    ...run.recommended ? [run.recommended] : [],
    ...Object.keys(run.metrics?.estimators ?? {}),
    ...Object.values(run.flights).flatMap(Object.keys),
  ]));
  return [...names];
}

/** The same numbers from 0 to 1 each time. */
function repeatable() {
  let state = 1;
  return () => {
    state = Math.imul(state, 1664525) + 1013904223 | 0;
    return (state >>> 8) / 2 ** 24;
  };
}

/** The difference of two runs' mean errors, and its interval: whole trajectories, each with [sum, number] of both runs, are drawn again. */
function difference(trajectories) {
  const of = drawn => {
    const [one, other] = [0, 1].map(run => drawn.reduce(([sum, number], both) => [sum + both[run][0], number + both[run][1]], [0, 0]));
    return other[0] / other[1] - one[0] / one[1];
  };
  if (!trajectories.length) return {};
  if (trajectories.length < 2) return { is: of(trajectories) };
  const random = repeatable();
  const draws = Array.from({ length: RESAMPLES }, () => of(trajectories.map(() => trajectories[Math.floor(random() * trajectories.length)])));
  draws.sort((one, other) => one - other);
  const at = share => draws[Math.round(share * (RESAMPLES - 1))];
  return { is: of(trajectories), interval: [at((1 - SHARE) / 2), at((1 + SHARE) / 2)] };
}

export class Comparison {
  constructor() {
    [this.figure, this.ticks] = [FIGURES[0][0], ''];
    this.element = element('section', { class: 'compared' });
  }

  /** Shows these runs. `scenarios`: the corpus's, with weather and trajectory. */
  show(runs, scenarios) {
    Object.assign(this, { runs, scenarios });
    this.draw();
  }

  draw() {
    const judged = this.runs.filter(run => run.metrics);
    const problems = this.runs.flatMap(run => run.problems.map(problem => element('p', { class: 'problem' }, `${run.name}: ${problem}`)));
    const figures = judged.flatMap(run => Object.values(run.metrics.estimators));
    const weathers = [...new Set(figures.flatMap(of => Object.keys(of.by_weather)))];
    const bins = new Map(figures.flatMap(of => of.by_distance_nm.map(bin => [`${bin.from_nm}`, `${bin.from_nm} to ${bin.to_nm} NM`])));
    const ticks = [['', 'all'], ...weathers.map(name => [`weather:${name}`, name]), ...[...bins].map(([nm, words]) => [`nm:${nm}`, words])];
    const set = name => value => {
      this[name] = value;
      this.draw();
      this.element.querySelector(`[data-of=${name}] select`).focus();
    };
    const field = (name, label, options) => element('span', { 'data-of': name }, choice(label, options, this[name], set(name)));
    this.element.replaceChildren(element('h2', {}, 'Runs'), ...judged.length ? [
      element('div', { class: 'filters' }, field('figure', 'Figure', FIGURES.map(([figure, title]) => [figure, title])), field('ticks', 'Ticks', ticks)),
      this.table(judged),
      element('p', { class: 'note' }, 'Over the judged ticks: the percentage error is |predicted − true| / true, MAPE its mean; 95 % of the answers have at most the error '
        + 'in %, or in m; coverage is the share of the ticks with an answer. The best of each run is bold.',
        judged.length > 1 && ` Differences are from ${judged[0].name}, over the flights that both have judged. The ${100 * SHARE} % interval draws whole trajectories again; a difference is bold if it excludes 0.`),
    ] : [], ...problems);
  }

  table(judged) {
    const [first, ...others] = judged;
    const [, , decimals] = FIGURES.find(([figure]) => figure === this.figure);
    const scale = this.figure === 'coverage' ? 100 : 1;
    const names = estimators(judged);
    const best = new Map(judged.map(run => {
      const values = names.map(name => this.value(run, name)).filter(Number.isFinite);
      return [run, this.figure === 'coverage' ? Math.max(...values) : Math.min(...values)];
    }));
    const text = value => fixed(Number.isFinite(value) ? value * scale : null, decimals);
    const strong = (is, words) => is ? element('strong', {}, words) : words;
    const value = (run, name) => element('td', { class: 'first' }, strong(this.value(run, name) === best.get(run), text(this.value(run, name))));
    const differs = (run, name) => {
      const { is, interval } = this.difference(first, run, name);
      const excludesZero = interval?.[0] > 0 || interval?.[1] < 0;
      return [
        element('td', {}, strong(excludesZero, `${is * scale > 0 ? '+' : ''}${text(is)}`)),
        ...this.figure === 'mape_pct' ? [element('td', { class: 'nowrap' }, interval ? `${text(interval[0])} to ${text(interval[1])}` : '–')] : [],
      ];
    };
    const heads = ['difference', ...this.figure === 'mape_pct' ? [`${100 * SHARE} % interval`] : []];
    const head = title => element('th', { scope: 'col' }, title);
    return element('div', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': 'Errors of the runs' }, element('table', { class: 'runs' },
      element('thead', {}, element('tr', {}, element('th', { class: 'word', scope: 'col' }, 'Estimator'),
        judged.map((run, index) => [element('th', { class: 'first', scope: 'col' }, run.name), ...index ? heads.map(head) : []]).flat())),
      element('tbody', {}, names.map(name => element('tr', {},
        element('th', { class: 'word', scope: 'row' }, element('code', {}, name),
          name === first.recommended && element('span', { class: 'note' }, ' recommended')),
        value(first, name), others.flatMap(run => [value(run, name), ...differs(run, name)]))))));
  }

  /** The chosen figure over the chosen ticks. */
  value(run, name) {
    const of = run.metrics.estimators[name];
    const [kind, which] = this.ticks.split(':');
    const figures = kind === 'weather' ? of?.by_weather[which] : kind === 'nm' ? of?.by_distance_nm.find(bin => `${bin.from_nm}` === which) : of;
    return figures?.[this.figure];
  }

  /** The difference of another run from the first one, with the interval of a mean error. */
  difference(first, other, name) {
    if (this.figure !== 'mape_pct') return { is: this.value(other, name) - this.value(first, name) };
    const [kind, which] = this.ticks.split(':');
    const trajectories = new Map();
    for (const { id, weather, trajectory } of this.scenarios) {
      if (kind === 'weather' && weather !== which) continue;
      const both = [first, other].map(run => run.flights[id]?.[name]?.by_nm);
      if (both.some(of => !of)) continue;
      const key = trajectory ?? id;
      const before = trajectories.get(key) ?? [[0, 0], [0, 0]];
      const added = both.map(of => Object.entries(of).filter(([nm]) => kind !== 'nm' || nm === which).map(([, sums]) => sums));
      trajectories.set(key, before.map((sums, run) => added[run].reduce(([sum, number], [of, many]) => [sum + of, number + many], sums)));
    }
    return difference([...trajectories.values()].filter(both => both.every(([, number]) => number > 0)));
  }
}
