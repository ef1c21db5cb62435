// The runs beside each other.

import { element } from './dom.js';
import { fixed } from './units.js';

const FIGURES = [
  ['mape_pct', 'MAPE %', 3], ['median_pct', 'median %', 3], ['p95_pct', '95 % in %', 2], ['p95_m', '95 % in m', 1],
  ['coverage', 'cover %', 1],
];

/** All names of estimators, those of the first run first. */
export function estimators(runs) {
  const names = new Set(runs.flatMap(run => [
    ...Object.keys(run.metrics?.estimators ?? {}),
    ...Object.values(run.flights).flatMap(Object.keys),
  ]));
  return [...names];
}

/** A table of the figures of all runs: a row for each estimator, a group of columns for each run. */
export function comparison(runs) {
  const judged = runs.filter(run => run.metrics);
  const problems = runs.flatMap(run => run.problems.map(problem => element('p', { class: 'problem' }, `${run.name}: ${problem}`)));
  if (!judged.length) return [...problems];
  const names = estimators(judged);
  const best = Object.fromEntries(FIGURES.map(([figure]) => {
    const values = judged.flatMap(run => names.map(name => run.metrics.estimators[name]?.[figure]).filter(Number.isFinite));
    return [figure, figure === 'coverage' ? Math.max(...values) : Math.min(...values)];
  }));
  const cell = (run, name, [figure, , decimals], index) => {
    const value = run.metrics.estimators[name]?.[figure];
    const shown = figure === 'coverage' && Number.isFinite(value) ? value * 100 : value;
    const text = fixed(shown, decimals);
    return element('td', { class: index ? undefined : 'first' }, value === best[figure] ? element('strong', {}, text) : text);
  };
  return [
    element('div', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': 'Errors of the runs' }, element('table', {},
      element('thead', {},
        element('tr', {}, element('th', { class: 'word', rowspan: 2, scope: 'col' }, 'Estimator'),
          judged.map(run => element('th', { class: 'group', colspan: FIGURES.length, scope: 'colgroup' }, run.name))),
        element('tr', {}, judged.flatMap(() =>
          FIGURES.map(([, title], index) => element('th', { class: index ? undefined : 'first', scope: 'col' }, title))))),
      element('tbody', {}, names.map(name => element('tr', {},
        element('th', { class: 'word', scope: 'row' }, element('code', {}, name)),
        judged.flatMap(run => FIGURES.map((figure, index) => cell(run, name, figure, index)))))))),
    element('p', { class: 'note' }, 'Over the judged ticks of all judged flights; the best of each kind is bold. The percentage error is |predicted − true| / true; MAPE is its mean. 95 %: the smallest error that ',
      '95 % of the answers do not exceed. Cover: share of the ticks with an answer.'),
    ...problems,
  ];
}
