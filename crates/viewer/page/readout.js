// What the tables and the runs say at the shown tick, in numbers.

import { drawStroke, line, stroke } from './colours.js';
import { check, element } from './dom.js';
import { METRES_PER_NM, brief, fixed, metres, nauticalMiles, seconds, speed } from './units.js';

/** Numbers of a flight. `online` is told that a line was chosen or dropped, `ongo` a tick to go to. */
export class Readout {
  constructor({ flight, runs, online, ongo }) {
    Object.assign(this, { flight, online, ongo });
    this.facts = element('dl', { class: 'readout' });
    this.answers = element('div', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': 'Predictions at this tick' },
      flight.lines.length ? this.table(runs.length > 1)
        : element('p', { class: 'note' }, runs.length ? 'The runs have no predictions for this scenario.'
          : 'No run is given: `dtd view CORPUS --run RUN` shows its errors.'));
  }

  table(hasSeveralRuns) {
    const whole = one => {
      const errors = one.error.filter(error => error !== null).map(Math.abs);
      return errors.length ? [errors.reduce((sum, error) => sum + error, 0) / errors.length, Math.max(...errors)] : [NaN, NaN];
    };
    const row = one => {
      one.cells = [element('td', { class: 'first' }), element('td'), element('td')];
      const [mean, worst] = whole(one);
      const worstTick = one.error.findIndex(error => error !== null && Math.abs(error) === worst);
      one.swatch = stroke(line(one.number));
      return element('tr', {},
        element('th', { class: 'word', scope: 'row' },
          check(one.estimator, one.isShown, isShown => this.online(one, isShown), one.swatch),
          hasSeveralRuns ? element('span', { class: 'note' }, one.run) : null),
        one.cells, element('td', { class: 'first' }, brief(mean, 3, 100)),
        element('td', {}, worstTick < 0 ? '–' : element('button', { type: 'button', class: 'go', title: `go to tick ${worstTick}`,
          onclick: () => this.ongo(worstTick) }, brief(worst, 2, 100))));
    };
    return element('table', {},
      element('thead', {}, element('tr', {}, element('th', { class: 'word', rowspan: 2, scope: 'col' }, 'Estimator'),
        element('th', { class: 'group', colspan: 3, scope: 'colgroup' }, 'At this tick'),
        element('th', { class: 'group', colspan: 2, scope: 'colgroup' }, 'Judged ticks, %')),
      element('tr', {}, ['NM', 'error, m', 'error, %', 'MAPE', 'worst'].map((title, index) =>
        element('th', { class: index === 0 || index === 3 ? 'first' : undefined, scope: 'col' }, title)))),
      element('tbody', {}, this.flight.lines.map(row)));
  }

  /** The numbers of a tick. */
  show(tick) {
    const { columns, lines } = this.flight;
    if (!columns) return;
    const facts = [
      ['Time', seconds(columns.time_s[tick])],
      ['Distance to touchdown', columns.dtd_m ? `${nauticalMiles(columns.dtd_m[tick])} (${metres(columns.dtd_m[tick])})` : '–'],
      ['Height over target', metres(columns.height_over_target_m[tick])],
      ['Right of centreline', metres(columns.cross_track_m[tick])],
      ['Ground speed', speed(columns.ground_speed_mps[tick])],
      ['True airspeed', speed(columns.true_airspeed_mps[tick])],
      ['Climb', `${fixed(columns.climb_mps[tick], 1)} m/s`],
      ['Heading, pitch, roll', ['heading_true_deg', 'pitch_deg', 'roll_deg'].map(name => `${fixed(columns[name][tick], 1)}°`).join(', ')],
      ['Ground', columns.on_ground[tick] ? 'a wheel touches it' : 'in the air'],
    ];
    this.values ??= facts.map(([term]) => {
      const value = element('dd');
      this.facts.append(element('div', {}, element('dt', {}, term), value));
      return value;
    });
    facts.forEach(([, text], index) => { this.values[index].textContent = text; });
    const truth = columns.dtd_m?.[tick];
    for (const { dtd, error, cells } of lines) {
      const isAnswered = dtd[tick] !== null;
      cells[0].textContent = isAnswered ? fixed(dtd[tick] / METRES_PER_NM, 3) : '–';
      cells[1].textContent = isAnswered && truth !== undefined ? brief(dtd[tick] - truth, 1, 1000) : '–';
      cells[2].textContent = brief(error[tick], 2, 100);
    }
  }

  /** Draws the strokes of the lines beside their names. */
  drawStrokes() {
    for (const { number, swatch } of this.flight.lines) drawStroke(swatch, line(number));
  }
}
