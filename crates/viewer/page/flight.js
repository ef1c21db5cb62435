// What the tables of a scenario and the runs say, by tick.

import { boxWords } from './picture.js';
import { METRES_PER_NM, fixed } from './units.js';

/** Lines that are shown unless the link says which; of a run without them, its first line. */
const FIRST_SHOWN = ['inverse_range', 'paper_lstm'];

/** Rows of a table of boxes by tick: the first aircraft's, or those of all others. */
function byTick(columns, make, isOfOthers = false) {
  const ticks = new Map();
  columns?.tick.forEach((tick, row) => {
    if (Boolean(columns.aircraft_number?.[row]) !== isOfOthers) return;
    if (!ticks.has(tick)) ticks.set(tick, []);
    ticks.get(tick).push(make(columns, row));
  });
  return ticks;
}

const boxOf = ({ cx_px, cy_px, width_px, height_px }, row) =>
  ({ cx: cx_px[row], cy: cy_px[row], width: width_px[row], height: height_px[row] });

/** The row of the tick next to this one that has any. */
function nearest(rows, tick) {
  let best = null;
  for (const other of rows.keys()) {
    if (best === null || Math.abs(other - tick) < Math.abs(best - tick)) best = other;
  }
  return best === null ? undefined : rows.get(best)[0];
}

/** A scenario. `tables` is what the server says about it, `runs` the names of the runs, `lines` the keys of the lines to show, if given. */
export class Flight {
  constructor({ tables, runs, model, lines }) {
    this.tables = tables;
    this.record = tables.record;
    this.views = tables.views;
    this.columns = tables.ticks;
    this.rate = tables.record.frame_rate;
    this.ticks = tables.record.ticks;
    const truth = (make, isOfOthers) => new Map(tables.views.map(view => [view.id, byTick(view.truth, make, isOfOthers)]));
    this.truth = truth((columns, row) => ({
      ...boxOf(columns, row), visible: columns.visible_fraction[row], transmission: columns.transmission[row] }), false);
    const types = tables.record.traffic?.map(other => `${other.aircraft_number} ${other.aircraft}`);
    this.others = truth((columns, row) => ({ ...boxOf(columns, row), label: types?.[columns.aircraft_number[row] - 1] }), true);
    this.collectLines(runs, lines?.split(','));
    this.use(tables.models.find(one => one.hash === model) ?? tables.models.at(-1));
  }

  /** What each estimator of each run answered: { key, run, estimator, dtd, error, isShown, number }, distances in metres, errors in percent. */
  collectLines(runs, keys) {
    const { tables } = this;
    this.lines = [];
    tables.runs.forEach((run, index) => {
      if (!run) return;
      const name = runs[index];
      for (const [estimator, answers] of Object.entries(run.estimators)) {
        if (!answers.some(answer => answer !== null)) continue;
        const dtd = new Array(this.ticks).fill(null);
        run.tick.forEach((tick, row) => { dtd[tick] = answers[row]; });
        const error = dtd.map((predicted, tick) => {
          const truth = tables.ticks?.dtd_m?.[tick];
          return predicted === null || !(truth > 0) ? null : (predicted - truth) / truth * 100;
        });
        this.lines.push({ key: runs.length > 1 ? `${name}:${estimator}` : estimator, run: name, estimator, dtd, error });
      }
    });
    // Lines that are often shown together have colours of their own.
    const isUsual = one => FIRST_SHOWN.includes(one.estimator);
    const ofRun = run => this.lines.filter(one => one.run === run);
    const isFirst = one => isUsual(one) || (!ofRun(one.run).some(isUsual) && ofRun(one.run)[0] === one);
    [...this.lines.filter(isFirst), ...this.lines.filter(one => !isFirst(one))].forEach((one, number) => { one.number = number; });
    this.lines.forEach(one => { one.isShown = keys ? keys.includes(one.key) : isFirst(one); });
  }

  /** Takes the detections and registrations of a model; undefined if there is none. */
  use(model) {
    this.model = model;
    const of = (table, make) => new Map(this.views.map(view => [view.id, byTick(model?.[table][view.id], make)]));
    this.detections = of('detections', (columns, row) => ({
      ...boxOf(columns, row), score: columns.score[row], confirmed: columns.confirmed[row], mode: columns.mode[row] }));
    this.registrations = of('registrations', (columns, row) => ({
      reference: columns.reference, x: columns.x_px[row], y: columns.y_px[row], dx: columns.dx_px[row], dy: columns.dy_px[row],
      reason: columns.reason[row] }));
    this.missed = new Map(this.views.map(view => {
      const columns = model?.detections[view.id];
      return [view.id, new Map(columns?.missed_tick.map((tick, row) => [tick, columns.missed_reason[row]]) ?? [])];
    }));
  }

  /** Boxes and points over a view's picture, the aircraft's place, and the same in words. `layers`: names of what is drawn. */
  seen(id, tick, layers) {
    const [truth, others] = [this.truth, this.others].map(boxes => boxes.get(id).get(tick) ?? []);
    const found = this.detections.get(id).get(tick) ?? [];
    const counted = this.counted(id, tick);
    const marks = [];
    if (layers.has('truth')) marks.push(...others.map(box => ({ kind: 'other', ...box })), ...truth.map(box => ({ kind: 'truth', ...box })));
    if (layers.has('detections')) marks.push(...found.map(box => ({ kind: box.confirmed ? 'detection' : 'unconfirmed', ...box })));
    if (layers.has('shifts')) marks.push(...this.shiftPoints(id, tick));
    const words = [];
    if (truth[0]) words.push(`ground-truth box ${boxWords(truth[0])}`);
    if (counted[0]) words.push(`detected ${boxWords(counted[0])}, score ${fixed(counted[0].score, 2)}`);
    else if (this.model) words.push(`no detection${this.missed.get(id).has(tick) ? `: ${this.missed.get(id).get(tick)}` : ''}`);
    const [registration] = this.registrations.get(id).get(tick) ?? [];
    if (registration) {
      words.push(registration.reason ? `no shift: ${registration.reason}`
        : `shift against ${registration.reference} ${fixed(registration.dx, 2)}, ${fixed(registration.dy, 2)} px`);
    }
    if (others.length) words.push(`other aircraft: ${others.map(box => box.label).join(', ')}`);
    return { marks, target: this.target(id, tick), words: words.join('; ') || 'nothing is known about this image' };
  }

  /** Detections of confirmed tracks, the surest first. */
  counted(id, tick) {
    const found = this.detections.get(id).get(tick) ?? [];
    return found.filter(box => box.confirmed).sort((one, other) => other.score - one.score);
  }

  /** Where the aircraft is in a view, or is thought to be: { x, y, width, height }, pixels; null if nothing is known. */
  target(id, tick) {
    const box = this.truth.get(id).get(tick)?.[0] ?? this.counted(id, tick)[0]
      ?? nearest(this.truth.get(id), tick) ?? nearest(this.detections.get(id), tick);
    return box ? { x: box.cx, y: box.cy, width: box.width, height: box.height } : null;
  }

  /** The followed point: in the reference view, and where it is in this one. */
  shiftPoints(id, tick) {
    const points = [];
    for (const [view, ticks] of this.registrations) {
      for (const { reference, x, y, dx, dy, reason } of ticks.get(tick) ?? []) {
        if (reason) continue;
        if (reference === id) points.push({ kind: 'shift', x, y });
        if (view === id) points.push({ kind: 'shift', x: x + dx, y: y + dy });
      }
    }
    return points;
  }

  /** Whether a view found the aircraft: found, unconfirmed, missed, away. */
  outcome(view, tick) {
    const found = this.detections.get(view.id).get(tick);
    if (found?.some(box => box.confirmed)) return 'found';
    if (found) return 'unconfirmed';
    if (!this.model) return 'away';
    const [truth] = this.truth.get(view.id).get(tick) ?? [];
    return (truth ? truth.visible > 0.5 : view.truth === null) ? 'missed' : 'away';
  }

  /** Distances to touchdown in nautical miles, negative past it; null without labels. */
  get distances() {
    const { along_track_m, dtd_m } = this.columns;
    return this.knownDistances ??= dtd_m && along_track_m.map((along, tick) => Math.sign(along) * dtd_m[tick] / METRES_PER_NM);
  }
}
