// One scenario: its pictures in step, with boxes over them; below, what the tables and the runs say, with one cursor.

import { LineChart, RowChart, range } from './chart.js';
import { colour, line, onSchemeChange } from './colours.js';
import { check, choice, element, json } from './dom.js';
import { FlownPaths } from './flown.js';
import { address, note, settle, shown } from './link.js';
import { MARKS, Picture, ZOOMS, boxWords } from './picture.js';
import { Player } from './playback.js';
import { isOpenable } from './scenarios.js';
import { METRES_PER_NM, count, fixed, metres, nauticalMiles, seconds, speed } from './units.js';

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16];
const LAYERS = { truth: 'True boxes', detections: 'Detections', shifts: 'Shifts' };
const WINDOWS_S = [['', 'whole flight'], ['300', '5 min'], ['60', '1 min'], ['10', '10 s']];
/** Lines that are shown unless the link says which. */
const FIRST_SHOWN = ['inverse_range', 'paper_lstm'];
/** States of the boxes of a view: what the cell means, and its colour. */
const CELLS = [
  ['found', 'found', 'series-1'], ['unconfirmed', 'found, but of no confirmed track', 'series-3'],
  ['missed', 'missed, though most of it is in the picture', 'bad'], ['away', 'not in the picture, or not searched', 'line'],
];
/** Errors far out would flatten all others. */
const SHOWN_SHARE = 0.985;

/** Rows of a table of boxes by tick. */
function byTick(columns, make) {
  const ticks = new Map();
  columns?.tick.forEach((tick, row) => {
    if (!ticks.has(tick)) ticks.set(tick, []);
    ticks.get(tick).push(make(columns, row));
  });
  return ticks;
}

const boxOf = ({ cx_px, cy_px, width_px, height_px }, row) =>
  ({ cx: cx_px[row], cy: cy_px[row], width: width_px[row], height: height_px[row] });

/** The page of a scenario. `tables` is what the server says about it. */
export class ScenarioPage {
  constructor({ corpus, tables, signal }) {
    Object.assign(this, { corpus, tables, signal });
    const { record } = tables;
    this.rate = record.frame_rate;
    this.ticks = record.ticks;
    this.truth = new Map(tables.views.map(view => [view.id, byTick(view.truth, (columns, row) => ({
      ...boxOf(columns, row), visible: columns.visible_fraction[row], transmission: columns.transmission[row] }))]));
    const asked = shown();
    this.zoom = ZOOMS.includes(Number(asked.zoom)) ? Number(asked.zoom) : null;
    this.layers = new Set(asked.layers === undefined ? Object.keys(LAYERS) : asked.layers.split(','));
    this.speed = SPEEDS.includes(Number(asked.speed)) ? Number(asked.speed) : 1;
    this.axis = asked.axis === 'dtd' && tables.ticks?.dtd_m ? 'dtd' : 'time';
    this.window_s = WINDOWS_S.some(([value]) => value === asked.window) ? asked.window : '';
    this.first = Math.max(0, Math.min(this.ticks - 1, Number.parseInt(asked.tick ?? '0', 10) || 0));
    this.tick = this.first;
    this.collectLines(asked.lines);
    this.useModel(tables.models.find(model => model.hash === asked.model) ?? tables.models.at(-1));
    this.pictures = tables.views.map(view => {
      const picture = new Picture(view, { onzoom: step => this.zoomBy(step), ondrag: () => this.noteCentres() });
      picture.zoom = this.zoom;
      const centre = asked[`centre.${view.id}`]?.split(',').map(Number);
      if (centre?.length === 2 && centre.every(Number.isFinite)) picture.centre = { x: centre[0], y: centre[1] };
      return picture;
    });
    this.player = new Player({
      scenario: record.id, views: tables.views, rate: this.rate, ticks: this.ticks,
      show: (tick, pictures) => this.showTick(tick, pictures), changed: () => this.showPlaying(),
    });
    signal.addEventListener('abort', () => this.player.close());
    addEventListener('keydown', event => this.onKey(event), { signal });
    onSchemeChange(() => this.drawCharts(), signal);
    this.build();
  }

  begin() {
    this.drawCharts();
    this.player.tick = this.first;
    this.player.step(this.first);
    this.readOtherPaths();
  }

  // What there is.

  collectLines(asked) {
    const { tables } = this;
    const several = this.corpus.runs.length > 1;
    this.lines = [];
    tables.runs.forEach((run, index) => {
      if (!run) return;
      const name = this.corpus.runs[index];
      for (const [estimator, answers] of Object.entries(run.estimators)) {
        if (!answers.some(answer => answer !== null)) continue;
        const dtd = new Array(this.ticks).fill(null);
        run.tick.forEach((tick, row) => { dtd[tick] = answers[row]; });
        const error = dtd.map((predicted, tick) => {
          const truth = tables.ticks?.dtd_m?.[tick];
          return predicted === null || !(truth > 0) ? null : (predicted - truth) / truth * 100;
        });
        this.lines.push({ key: several ? `${name}:${estimator}` : estimator, run: name, estimator, dtd, error });
      }
    });
    const keys = asked?.split(',');
    // Lines that are often shown together have colours of their own.
    const isFirst = one => FIRST_SHOWN.includes(one.estimator);
    [...this.lines.filter(isFirst), ...this.lines.filter(one => !isFirst(one))].forEach((one, number) => { one.number = number; });
    this.lines.forEach(one => {
      one.isShown = keys ? keys.includes(one.key) : FIRST_SHOWN.includes(one.estimator);
    });
    if (!keys && !this.lines.some(one => one.isShown) && this.lines.length) this.lines[0].isShown = true;
  }

  useModel(model) {
    this.model = model;
    const of = (table, make) => new Map(this.tables.views.map(view => [view.id, byTick(model?.[table][view.id], make)]));
    this.detections = of('detections', (columns, row) => ({
      ...boxOf(columns, row), score: columns.score[row], confirmed: columns.confirmed[row], mode: columns.mode[row] }));
    this.registrations = of('registrations', (columns, row) => ({
      reference: columns.reference, x: columns.x_px[row], y: columns.y_px[row], dx: columns.dx_px[row], dy: columns.dy_px[row],
      reason: columns.reason[row] }));
    this.missed = new Map(this.tables.views.map(view => {
      const columns = model?.detections[view.id];
      return [view.id, new Map(columns?.missed_tick.map((tick, row) => [tick, columns.missed_reason[row]]) ?? [])];
    }));
  }

  // The page.

  build() {
    const { tables } = this;
    const { record } = tables;
    const { conditions } = record;
    const row = this.corpus.scenarios.find(one => one.id === record.id);
    const ids = this.corpus.scenarios.filter(isOpenable).map(one => one.id);
    const at = ids.indexOf(record.id);
    this.neighbours = { N: ids[at + 1], P: ids[at - 1] };
    const neighbour = (key, text) => this.neighbours[key]
      ? element('a', { href: address({ ...this.kept(), scenario: this.neighbours[key] }) }, text) : element('span', { class: 'note' }, text);
    const fact = (term, value) => element('div', {}, element('dt', {}, term), element('dd', {}, value));
    const problems = [
      ...tables.problems,
      ...row?.state === 'damaged' ? row.faults : [],
      ...tables.ticks && !tables.ticks.dtd_m ? ['This scenario has no labels: `dtd label` adds true boxes and distances.'] : [],
      ...!tables.models.length ? ['No detections: `dtd detect` adds them.'] : [],
    ];
    this.slider = element('input', { type: 'range', class: 'ticks', min: 0, max: this.ticks - 1, step: 1, value: this.tick,
      'aria-label': 'Tick', oninput: () => this.goTo(Number(this.slider.value)) });
    this.number = element('input', { type: 'number', min: 0, max: this.ticks - 1, value: this.tick,
      onchange: () => this.goTo(Number(this.number.value)) });
    this.playButton = element('button', { type: 'button', class: 'play', onclick: () => this.togglePlaying() }, 'Play');
    this.layerBoxes = {};
    this.zoomChoice = choice('Zoom', ZOOMS.map(zoom => [String(zoom ?? ''), zoom ? `${zoom} ×` : 'whole']), String(this.zoom ?? ''),
      value => this.setZoom(value ? Number(value) : null));
    this.readout = element('dl', { class: 'readout' });
    this.charts = this.buildCharts();
    this.answers = element('div', { class: 'scroll', tabindex: '0', role: 'region', 'aria-label': 'Predictions at this tick' });
    this.flown = new FlownPaths({ height: 150, onpick: id => { location.hash = address({ ...this.kept(), scenario: id }); } });
    if (tables.ticks) this.flown.add(record.id, tables.ticks);
    this.flown.chosen = record.id;
    this.flown.glide_path_deg = record.runway.glide_path_deg;
    const axes = [['time', 'time'], ...tables.ticks?.dtd_m ? [['dtd', 'distance to touchdown']] : []];
    this.element = element('div', { class: 'scenario' },
      element('section', { class: 'head', 'aria-labelledby': 'title' },
        element('nav', { 'aria-label': 'Scenarios' }, element('a', { href: '#' }, 'All scenarios'), neighbour('P', 'Previous'), neighbour('N', 'Next')),
        element('h1', { id: 'title' }, record.id),
        element('dl', { class: 'facts' },
          fact('Weather', `${conditions.weather_name}, visibility ${metres(conditions.weather.visibility_m)}`),
          fact('Local time', conditions.time_of_day), fact('Side', row?.side ?? '–'),
          fact('Runway', `${record.runway.airport} ${record.runway.name}`), fact('Trajectory', record.trajectory),
          fact('Ticks', `${count(this.ticks)}, ${this.rateWords()}`)),
        problems.map(problem => element('p', { class: 'problem' }, problem))),
      element('section', { class: 'player', 'aria-label': 'Pictures' },
        element('div', { class: 'views', style: `--views: ${Math.max(1, this.pictures.length)}` }, this.pictures.map(picture => picture.element)),
        element('div', { class: 'transport' },
          this.playButton,
          element('button', { type: 'button', title: 'one tick back', 'aria-label': 'one tick back', onclick: () => this.stepBy(-1) }, '◂'),
          element('button', { type: 'button', title: 'one tick forward', 'aria-label': 'one tick forward', onclick: () => this.stepBy(1) }, '▸'),
          this.slider, element('label', { class: 'field' }, element('span', {}, 'Tick'), this.number),
          choice('Speed', SPEEDS.map(value => [String(value), `${value} ×`]), String(this.speed), value => this.setSpeed(Number(value))),
          this.zoomChoice,
          element('button', { type: 'button', onclick: () => this.follow() }, 'Follow aircraft')),
        element('div', { class: 'layers' },
          Object.entries(LAYERS).map(([layer, label]) => this.layerCheck(layer, label)),
          check('Inset', true, isShown => this.pictures.forEach(picture => {
            picture.hasInset = isShown;
            picture.draw();
          })),
          tables.models.length > 1 ? choice('Detections of', tables.models.map(model => [model.hash, model.name]), this.model?.hash, hash => {
            this.useModel(tables.models.find(model => model.hash === hash));
            note({ model: hash });
            this.showMarks();
            this.drawCharts();
          }) : tables.models.length ? element('span', { class: 'note' }, `of ${tables.models[0].name}`) : null)),
      element('section', { class: 'now', 'aria-labelledby': 'now-title' }, element('h2', { id: 'now-title' }, 'At this tick'), this.readout, this.answers,
        element('h2', {}, 'Flown paths'), this.flown.element),
      element('section', { class: 'charts', 'aria-label': 'Charts' },
        element('div', { class: 'layers' },
          choice('Over', axes, this.axis, value => this.setAxis(value)),
          choice('Show', WINDOWS_S, this.window_s, value => this.setWindow(value)),
          element('span', { class: 'note' }, 'Click or drag in a chart to go to a tick.')),
        this.charts.map(chart => chart.canvas), element('p', { class: 'axis', id: 'axis' }),
        element('ul', { class: 'legend', 'aria-label': 'Boxes found' }, CELLS.map(([kind, words]) =>
          element('li', {}, element('span', { class: `swatch ${kind}` }), words)))));
    this.axisName = this.element.querySelector('#axis');
    this.buildAnswers();
  }

  layerCheck(layer, label) {
    const { colour } = MARKS[{ truth: 'truth', detections: 'detection', shifts: 'shift' }[layer]];
    const swatch = element('span', { class: 'swatch' });
    swatch.style.background = colour;
    const made = check(label, this.layers.has(layer), isShown => this.setLayer(layer, isShown), swatch);
    this.layerBoxes[layer] = made.querySelector('input');
    return made;
  }

  rateWords() {
    const { numerator, denominator } = this.rate;
    return numerator >= denominator ? `${fixed(numerator / denominator, numerator % denominator ? 2 : 0)} a second`
      : `one every ${fixed(denominator / numerator, denominator % numerator ? 2 : 0)} s`;
  }

  /** What a link to another scenario keeps. */
  kept() {
    const { tick, scenario, ...kept } = shown();
    return Object.fromEntries(Object.entries(kept).filter(([name]) => !name.startsWith('centre.')));
  }

  // Pictures and ticks.

  goTo(tick) {
    if (!Number.isFinite(tick)) return;
    this.player.pause();
    this.player.step(tick);
  }

  stepBy(ticks) {
    this.goTo((this.player.wanted ?? this.player.tick) + ticks);
  }

  togglePlaying() {
    if (this.player.isPlaying) this.player.pause();
    else this.player.play(this.speed);
  }

  showPlaying() {
    this.playButton.textContent = this.player.isPlaying ? 'Pause' : 'Play';
    if (!this.player.isPlaying) note({ tick: this.player.tick });
  }

  setSpeed(speed) {
    this.speed = speed;
    note({ speed: speed === 1 ? undefined : speed });
    if (this.player.isPlaying) {
      this.player.pause();
      this.player.play(speed);
    }
  }

  /** Shows a tick: `pictures` has an image or an error for each view. */
  showTick(tick, pictures) {
    this.tick = tick;
    this.pictures.forEach((picture, index) => {
      const found = pictures[index];
      const isError = found instanceof Error;
      picture.image = isError ? null : found;
      picture.message = isError ? found.message : '';
    });
    this.showMarks();
    // A picture of a video is only lent.
    if (this.player.isPlaying) this.pictures.forEach(picture => { if (picture.image instanceof globalThis.VideoFrame) picture.image = null; });
    this.slider.value = tick;
    if (document.activeElement !== this.number) this.number.value = tick;
    this.slider.setAttribute('aria-valuetext', this.tickWords(tick));
    this.showReadout();
    this.moveCursor();
    this.element.dataset.tick = tick;
    if (!this.player.isPlaying) note({ tick });
  }

  tickWords(tick) {
    const ticks = this.tables.ticks;
    if (!ticks) return `tick ${tick}`;
    const dtd = ticks.dtd_m ? `, ${nauticalMiles(ticks.dtd_m[tick])} to touchdown` : '';
    return `tick ${tick}, ${seconds(ticks.time_s[tick])}${dtd}`;
  }

  showMarks() {
    for (const picture of this.pictures) {
      const { id } = picture.view;
      const truth = this.truth.get(id).get(this.tick) ?? [];
      const found = this.detections.get(id).get(this.tick) ?? [];
      const counted = found.filter(box => box.confirmed).sort((one, other) => other.score - one.score);
      const marks = [];
      if (this.layers.has('truth')) marks.push(...truth.map(box => ({ kind: 'truth', ...box })));
      if (this.layers.has('detections')) {
        marks.push(...found.map(box => ({ kind: box.confirmed ? 'detection' : 'unconfirmed', ...box })));
      }
      const points = this.shiftPoints(id);
      if (this.layers.has('shifts')) marks.push(...points);
      picture.marks = marks;
      picture.target = target(truth[0] ?? counted[0]) ?? target(this.nearest(this.truth.get(id)) ?? this.nearest(this.detections.get(id)));
      const words = [];
      if (truth[0]) words.push(`true box ${boxWords(truth[0])}`);
      if (counted[0]) words.push(`detected ${boxWords(counted[0])}, score ${fixed(counted[0].score, 2)}`);
      else if (this.model) words.push(`no detection${this.missed.get(id).has(this.tick) ? `: ${this.missed.get(id).get(this.tick)}` : ''}`);
      const [registration] = this.registrations.get(id).get(this.tick) ?? [];
      if (registration) {
        words.push(registration.reason ? `no shift: ${registration.reason}`
          : `shift to ${registration.reference} ${fixed(registration.dx, 2)}, ${fixed(registration.dy, 2)} px`);
      }
      picture.say(picture.message || words.join('; ') || 'nothing is known about this picture');
      picture.draw();
    }
  }

  /** The followed point: in the reference view, and where it is in this one. */
  shiftPoints(id) {
    const points = [];
    for (const [view, ticks] of this.registrations) {
      for (const { reference, x, y, dx, dy, reason } of ticks.get(this.tick) ?? []) {
        if (reason) continue;
        if (reference === id) points.push({ kind: 'shift', x, y });
        if (view === id) points.push({ kind: 'shift', x: x + dx, y: y + dy });
      }
    }
    return points;
  }

  /** The box of the nearest tick that has one: where the aircraft is about. */
  nearest(boxes) {
    let best = null;
    for (const tick of boxes.keys()) {
      if (best === null || Math.abs(tick - this.tick) < Math.abs(best - this.tick)) best = tick;
    }
    return best === null ? undefined : boxes.get(best)[0];
  }

  setLayer(layer, isShown) {
    if (isShown) this.layers.add(layer);
    else this.layers.delete(layer);
    this.layerBoxes[layer].checked = isShown;
    note({ layers: this.layers.size === Object.keys(LAYERS).length ? undefined : [...this.layers].join(',') || 'none' });
    this.showMarks();
  }

  setZoom(zoom) {
    this.zoom = zoom;
    this.zoomChoice.querySelector('select').value = String(zoom ?? '');
    for (const picture of this.pictures) {
      picture.zoom = zoom;
      picture.draw();
    }
    note({ zoom: zoom ?? undefined });
  }

  zoomBy(step) {
    const index = ZOOMS.indexOf(this.zoom) + step;
    if (index >= 0 && index < ZOOMS.length) this.setZoom(ZOOMS[index]);
  }

  follow() {
    for (const picture of this.pictures) {
      picture.centre = null;
      picture.draw();
    }
    if (this.zoom === null) this.setZoom(8);
    this.noteCentres();
  }

  noteCentres() {
    note(Object.fromEntries(this.pictures.map(({ view, centre }) =>
      [`centre.${view.id}`, centre ? `${centre.x.toFixed(1)},${centre.y.toFixed(1)}` : undefined])));
  }

  // What the tables say at a tick.

  showReadout() {
    const { ticks } = this.tables;
    if (!ticks) return;
    const { tick } = this;
    const facts = [
      ['Time', seconds(ticks.time_s[tick])],
      ['Distance to touchdown', ticks.dtd_m ? `${nauticalMiles(ticks.dtd_m[tick])} (${metres(ticks.dtd_m[tick])})` : '–'],
      ['Height over target', metres(ticks.height_over_target_m[tick])],
      ['Right of centreline', metres(ticks.cross_track_m[tick])],
      ['Ground speed', speed(ticks.ground_speed_mps[tick])],
      ['True airspeed', speed(ticks.true_airspeed_mps[tick])],
      ['Climb', `${fixed(ticks.climb_mps[tick], 1)} m/s`],
      ['Heading, pitch, roll', `${fixed(ticks.heading_true_deg[tick], 1)}°, ${fixed(ticks.pitch_deg[tick], 1)}°, ${fixed(ticks.roll_deg[tick], 1)}°`],
      ['Ground', ticks.on_ground[tick] ? 'a wheel touches it' : 'in the air'],
    ];
    this.readoutValues ??= facts.map(([term]) => {
      const value = element('dd');
      this.readout.append(element('div', {}, element('dt', {}, term), value));
      return value;
    });
    facts.forEach(([, text], index) => { this.readoutValues[index].textContent = text; });
    for (const one of this.lines) {
      one.cells[0].textContent = fixed(one.dtd[tick] === null ? null : one.dtd[tick] / METRES_PER_NM, 3);
      const truth = ticks.dtd_m?.[tick];
      one.cells[1].textContent = one.dtd[tick] === null || truth === undefined ? '–' : fixed(one.dtd[tick] - truth, 1);
      one.cells[2].textContent = fixed(one.error[tick], 2);
    }
    const x = ticks.along_track_m[tick] / METRES_PER_NM;
    this.flown.mark({ along: x, cross: ticks.cross_track_m[tick], height: ticks.height_over_target_m[tick] });
  }

  buildAnswers() {
    if (!this.lines.length) {
      this.answers.append(element('p', { class: 'note' }, this.corpus.runs.length ? 'The runs have no predictions for this scenario.'
        : 'No run is given: `dtd view CORPUS --run RUN` shows its errors.'));
      return;
    }
    const several = this.corpus.runs.length > 1;
    const whole = one => {
      const errors = one.error.filter(error => error !== null).map(Math.abs);
      return errors.length ? [errors.reduce((sum, error) => sum + error, 0) / errors.length, Math.max(...errors)] : [NaN, NaN];
    };
    const row = one => {
      one.cells = [element('td', { class: 'first' }), element('td'), element('td')];
      const [mean, worst] = whole(one);
      const worstTick = one.error.findIndex(error => error !== null && Math.abs(error) === worst);
      const swatch = element('canvas', { width: 28, height: 10, class: 'stroke' });
      one.swatch = swatch;
      return element('tr', {},
        element('th', { class: 'word', scope: 'row' },
          check(one.estimator, one.isShown, isShown => this.showLine(one, isShown), swatch), several ? element('span', { class: 'note' }, one.run) : null),
        one.cells, element('td', { class: 'first' }, fixed(mean, 3)),
        element('td', {}, worstTick < 0 ? '–' : element('button', { type: 'button', class: 'go', title: `go to tick ${worstTick}`,
          onclick: () => this.goTo(worstTick) }, fixed(worst, 2))));
    };
    this.answers.append(element('table', {},
      element('thead', {}, element('tr', {}, element('th', { class: 'word', rowspan: 2, scope: 'col' }, 'Estimator'),
        element('th', { class: 'group', colspan: 3, scope: 'colgroup' }, 'At this tick'),
        element('th', { class: 'group', colspan: 2, scope: 'colgroup' }, 'Judged ticks, %')),
      element('tr', {}, ['NM', 'error, m', 'error, %', 'MAPE', 'worst'].map((title, index) =>
        element('th', { class: index === 0 || index === 3 ? 'first' : undefined, scope: 'col' }, title)))),
      element('tbody', {}, this.lines.map(row))));
  }

  showLine(one, isShown) {
    one.isShown = isShown;
    note({ lines: this.lines.filter(other => other.isShown).map(other => other.key).join(',') || 'none' });
    this.drawCharts();
  }

  // Charts.

  buildCharts() {
    const { ticks } = this.tables;
    if (!ticks) return [];
    this.distance = new LineChart({ title: 'Distance to touchdown', unit: 'NM', height: 130, bottom: false });
    this.error = new LineChart({ title: 'Error: predicted − true', unit: '% of the distance', height: 150, bottom: false });
    this.speeds = new LineChart({ title: 'Ground speed, and true airspeed (dashed)', unit: 'm/s', height: 100, bottom: false });
    this.found = new RowChart({ title: 'Boxes found', height: 48 + 22 * this.tables.views.length });
    const charts = [this.distance, ...this.lines.length && ticks.dtd_m ? [this.error] : [], this.speeds, this.found];
    for (const chart of charts) {
      const go = (x, event) => {
        if (event.buttons & 1) this.goTo(this.tickAt(x));
      };
      chart.onpoint = go;
      chart.onpick = go;
    }
    return charts;
  }

  get xs() {
    const { ticks } = this.tables;
    if (this.axis === 'time') return ticks.time_s;
    return this.distances ??= ticks.along_track_m.map((along, tick) => Math.sign(along) * ticks.dtd_m[tick] / METRES_PER_NM);
  }

  tickAt(x) {
    const { xs } = this;
    let best = 0;
    for (let tick = 1; tick < xs.length; tick++) if (Math.abs(xs[tick] - x) < Math.abs(xs[best] - x)) best = tick;
    return best;
  }

  drawCharts() {
    const { ticks } = this.tables;
    if (!ticks) return;
    const { xs } = this;
    const nm = values => values.map(value => value === null ? null : value / METRES_PER_NM);
    const style = one => line(one.number);
    const visible = this.lines.filter(one => one.isShown);
    this.distance.lines = [
      ...ticks.dtd_m ? [{ x: xs, y: nm(ticks.dtd_m), colour: colour('ink'), width: 2 }] : [],
      ...visible.map(one => ({ x: xs, y: nm(one.dtd), ...style(one) })),
    ];
    this.distance.title = ticks.dtd_m ? 'Distance to touchdown: true (bold) and predicted' : 'Distance to touchdown: no labels yet';
    this.error.lines = visible.map(one => ({ x: xs, y: one.error, ...style(one) }));
    this.speeds.lines = [
      { x: xs, y: ticks.ground_speed_mps, colour: colour('series-0') },
      { x: xs, y: ticks.true_airspeed_mps, colour: colour('series-4'), dash: [5, 3] },
    ];
    this.found.rows = this.tables.views.map(view => ({ name: view.id, cells: this.cells(view) }));
    this.distance.y = range(this.distance.lines.flatMap(one => one.y));
    this.error.y = mostOf(this.error.lines.flatMap(one => one.y));
    this.speeds.y = range(this.speeds.lines.flatMap(one => one.y));
    for (const one of this.lines) {
      const context = one.swatch.getContext('2d');
      context.clearRect(0, 0, 28, 10);
      const { colour, dash } = style(one);
      context.strokeStyle = colour;
      context.lineWidth = 3;
      context.setLineDash(dash);
      context.beginPath();
      context.moveTo(0, 5);
      context.lineTo(28, 5);
      context.stroke();
    }
    this.axisName.textContent = this.axis === 'time' ? 'time since the first tick, s' : 'distance to touchdown, NM; negative past it';
    this.flown.draw();
    this.moveCursor();
    for (const chart of this.charts) chart.draw();
  }

  /** Runs of ticks with the same state of a view's boxes. */
  cells(view) {
    const colours = Object.fromEntries(CELLS.map(([kind, , name]) => [kind, colour(name)]));
    const { xs } = this;
    const state = tick => {
      const found = this.detections.get(view.id).get(tick);
      if (found?.some(box => box.confirmed)) return 'found';
      if (found) return 'unconfirmed';
      const [truth] = this.truth.get(view.id).get(tick) ?? [];
      return (truth ? truth.visible > 0.5 : view.truth === null && this.model) ? 'missed' : 'away';
    };
    const cells = [];
    let from = 0;
    for (let tick = 1; tick <= this.ticks; tick++) {
      if (tick < this.ticks && state(tick) === state(from)) continue;
      const end = tick < this.ticks ? xs[tick] : xs[tick - 1] + (xs[tick - 1] - (xs[tick - 2] ?? xs[tick - 1]));
      cells.push({ from: xs[from], to: end, colour: colours[state(from)] });
      from = tick;
    }
    return cells;
  }

  moveCursor() {
    if (!this.tables.ticks) return;
    const { xs } = this;
    const ends = [xs[0], xs.at(-1)];
    let shownRange = ends[0] === ends[1] ? [ends[0] - 1, ends[0] + 1] : ends;
    if (this.window_s) {
      const half = Math.round(Number(this.window_s) / 2 * this.rate.numerator / this.rate.denominator);
      const [first, last] = [Math.max(0, this.tick - half), Math.min(this.ticks - 1, this.tick + half)];
      if (last > first) shownRange = [xs[first], xs[last]];
    }
    for (const chart of this.charts) {
      chart.moveTo(xs[this.tick], shownRange);
    }
  }

  setAxis(axis) {
    this.axis = axis;
    note({ axis: axis === 'time' ? undefined : axis });
    this.drawCharts();
  }

  setWindow(window_s) {
    this.window_s = window_s;
    note({ window: window_s });
    this.moveCursor();
  }

  async readOtherPaths() {
    for (const row of this.corpus.scenarios) {
      if (this.signal.aborted) return;
      if (row.id === this.tables.record.id || row.trajectory !== this.tables.record.trajectory) continue;
      try {
        this.flown.add(row.id, await json('/api/path', { scenario: row.id }));
      } catch {
        // The table of scenarios says what is wrong with it.
      }
    }
    if (!this.signal.aborted) this.flown.draw();
  }

  // Keys.

  onKey(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || document.querySelector('dialog[open]')) return;
    const isTyping = event.target.matches('input[type=number], input[type=search], select');
    const isSlider = event.target === this.slider;
    if ((isTyping && event.key !== 'Escape') || (event.target.matches('button, input[type=checkbox]') && [' ', 'Enter'].includes(event.key))) return;
    const toggle = layer => this.setLayer(layer, !this.layers.has(layer));
    const leave = scenario => {
      settle();
      location.hash = scenario ? address({ ...this.kept(), scenario }) : '';
    };
    const open = key => this.neighbours[key] && leave(this.neighbours[key]);
    const far = event.shiftKey ? 10 : 1;
    const actions = {
      ArrowLeft: () => this.stepBy(-far), ArrowRight: () => this.stepBy(far), Home: () => this.goTo(0), End: () => this.goTo(this.ticks - 1),
      ' ': () => this.togglePlaying(), '+': () => this.zoomBy(1), '=': () => this.zoomBy(1), '-': () => this.zoomBy(-1),
      0: () => this.setZoom(null), f: () => this.follow(), t: () => toggle('truth'), d: () => toggle('detections'), s: () => toggle('shifts'),
      n: () => open('N'), p: () => open('P'), Escape: () => leave(),
    };
    const action = actions[event.key] ?? actions[event.key.toLowerCase()];
    if (!action) return;
    // Focusable regions that scroll keep their own keys.
    if (event.target.matches('.scroll') && event.key.startsWith('Arrow')) return;
    event.preventDefault();
    if (isSlider) this.slider.blur();
    action();
  }
}

function target(box) {
  return box ? { x: box.cx, y: box.cy, width: box.width } : null;
}

/** A range around 0 that holds most values. */
function mostOf(values) {
  const sizes = values.filter(value => value !== null).map(Math.abs).sort((one, other) => one - other);
  if (!sizes.length) return [-1, 1];
  const size = Math.max(0.1, sizes[Math.floor((sizes.length - 1) * SHOWN_SHARE)] * 1.25);
  return [-size, size];
}
