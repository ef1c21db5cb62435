// One scenario: its pictures in step, with boxes over them; below, what the tables and the runs say, with one cursor.

import { onSchemeChange } from './colours.js';
import { check, choice, element, json } from './dom.js';
import { Flight } from './flight.js';
import { FlightCharts } from './flight-charts.js';
import { FlownPaths } from './flown.js';
import { address, note, settle, shown } from './link.js';
import { MARKS, Picture, ZOOMS } from './picture.js';
import { Player } from './playback.js';
import { Readout } from './readout.js';
import { isOpenable } from './scenarios.js';
import { METRES_PER_NM, count, fixed, metres, nauticalMiles, seconds, speed } from './units.js';

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16];
const LAYERS = { truth: 'Ground-truth boxes', detections: 'Detections', shifts: 'Shifts' };

/** What the simulator reported at the aircraft; what it did not report is left out. */
function weatherWords(weather) {
  const covers = weather.cloud_cover_ratios.filter(cover => cover !== null);
  const parts = [
    ['visibility', weather.visibility_m, metres], ['wind', weather.wind_speed_mps, speed],
    ['from', weather.wind_from_true_deg, value => `${fixed(value, 0)}°`], ['rain', weather.rain_ratio, value => fixed(value, 2)],
    ['cloud cover', covers.length ? Math.max(...covers) : null, value => fixed(value, 2)],
  ];
  return parts.filter(([, value]) => value !== null).map(([name, value, words]) => `${name} ${words(value)}`).join(', ');
}

/** The page of a scenario. `tables` is what the server says about it. */
export class ScenarioPage {
  constructor({ corpus, tables, signal }) {
    Object.assign(this, { corpus, tables, signal });
    const asked = shown();
    const flight = new Flight({ tables, runs: corpus.runs, model: asked.model, lines: asked.lines });
    const go = tick => this.goTo(tick);
    this.flight = flight;
    this.ticks = flight.ticks;
    this.zoom = ZOOMS.includes(Number(asked.zoom)) ? Number(asked.zoom) : null;
    this.layers = new Set(asked.layers === undefined ? Object.keys(LAYERS) : asked.layers.split(','));
    this.speed = SPEEDS.includes(Number(asked.speed)) ? Number(asked.speed) : 1;
    this.first = Math.max(0, Math.min(this.ticks - 1, Number.parseInt(asked.tick ?? '0', 10) || 0));
    this.tick = this.first;
    this.pictures = flight.views.map(view => {
      const picture = new Picture(view, {
        onzoom: step => this.zoomBy(step), ondrag: () => this.noteCentres(), onneed: () => this.player?.refresh() });
      picture.zoom = this.zoom;
      const centre = asked[`centre.${view.id}`]?.split(',').map(Number);
      if (centre?.length === 2 && centre.every(Number.isFinite)) picture.centre = { x: centre[0], y: centre[1] };
      return picture;
    });
    this.player = new Player({
      scenario: flight.record.id, views: flight.views, rate: flight.rate, ticks: this.ticks,
      need: (index, tick) => this.pictures[index].need(flight.target(flight.views[index].id, tick)),
      show: (tick, pictures) => this.showTick(tick, pictures), changed: () => this.showPlaying(),
    });
    this.charts = new FlightCharts({ flight, asked, ongo: go });
    this.readout = new Readout({ flight, runs: corpus.runs, ongo: go, online: (one, isShown) => this.showLine(one, isShown) });
    this.flown = new FlownPaths({ height: 150, onpick: id => { location.hash = address({ ...this.kept(), scenario: id }); } });
    if (tables.ticks) this.flown.add(flight.record.id, tables.ticks);
    this.flown.chosen = flight.record.id;
    this.flown.glide_path_deg = flight.record.runway.glide_path_deg;
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

  // The page.

  build() {
    this.slider = element('input', { type: 'range', class: 'ticks', min: 0, max: this.ticks - 1, step: 1, value: this.tick,
      'aria-label': 'Tick', oninput: () => this.goTo(Number(this.slider.value)) });
    this.number = element('input', { type: 'number', min: 0, max: this.ticks - 1, value: this.tick,
      onchange: () => this.goTo(Number(this.number.value)) });
    this.playButton = element('button', { type: 'button', class: 'play', onclick: () => this.togglePlaying() }, 'Play');
    this.zoomChoice = choice('Zoom', ZOOMS.map(zoom => [String(zoom ?? ''), zoom ? `${zoom} ×` : 'whole']), String(this.zoom ?? ''),
      value => this.setZoom(value ? Number(value) : null));
    this.layerBoxes = {};
    this.element = element('div', { class: 'scenario' },
      this.head(),
      element('section', { class: 'player', 'aria-label': 'Pictures' },
        element('div', { class: this.pictures.length > 1 ? 'views' : 'views single' }, this.pictures.map(picture => picture.element)),
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
            this.player.refresh();
          })),
          this.modelChoice())),
      element('section', { class: 'now', 'aria-labelledby': 'now-title' },
        element('h2', { id: 'now-title' }, 'At this tick'), this.readout.facts, this.readout.answers,
        element('h2', {}, 'Flown paths'), this.flown.element),
      this.charts.element);
  }

  /** Where one is, and what the scenario is. */
  head() {
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
    const others = record.traffic?.map(other => `${other.aircraft_number} ${other.aircraft} (${other.role})`) ?? [];
    const problems = [
      ...tables.problems,
      ...(row?.weather_differs ?? []).map(difference => `Not the planned weather: ${difference}.`),
      ...row?.state === 'damaged' ? row.faults : [],
      ...tables.ticks && !tables.ticks.dtd_m ? ['This scenario has no labels: `dtd label` adds ground-truth boxes and distances.'] : [],
      ...!tables.models.length ? ['No detections: `dtd detect` adds them.'] : [],
    ];
    return element('section', { class: 'head', 'aria-labelledby': 'title' },
      element('nav', { 'aria-label': 'Scenarios' }, element('a', { href: '#' }, 'All scenarios'), neighbour('P', 'Previous'), neighbour('N', 'Next')),
      element('h1', { id: 'title' }, record.id),
      element('dl', { class: 'facts' },
        fact('Weather', `${conditions.weather_name}, visibility ${metres(conditions.weather.visibility_m)}`),
        ...record.effective_weather ? [fact('At the aircraft', weatherWords(record.effective_weather))] : [],
        fact('Local time', conditions.time_of_day), fact('Side', row?.side ?? '–'),
        fact('Runway', `${record.runway.airport} ${record.runway.name}`), fact('Aircraft', [record.aircraft, ...others].join(', ')),
        fact('Trajectory', record.trajectory),
        fact('Ticks', `${count(this.ticks)}, ${this.rateWords()}`)),
      problems.map(problem => element('p', { class: 'problem' }, problem)));
  }

  rateWords() {
    const { numerator, denominator } = this.flight.rate;
    return numerator >= denominator ? `${fixed(numerator / denominator, numerator % denominator ? 2 : 0)} a second`
      : `one every ${fixed(denominator / numerator, denominator % numerator ? 2 : 0)} s`;
  }

  layerCheck(layer, label) {
    const { colour } = MARKS[{ truth: 'truth', detections: 'detection', shifts: 'shift' }[layer]];
    const swatch = element('span', { class: 'swatch' });
    swatch.style.background = colour;
    const made = check(label, this.layers.has(layer), isShown => this.setLayer(layer, isShown), swatch);
    this.layerBoxes[layer] = made.querySelector('input');
    return made;
  }

  modelChoice() {
    const { models } = this.tables;
    if (models.length < 2) return models.length ? element('span', { class: 'note' }, `of ${models[0].name}`) : null;
    return choice('Detections of', models.map(model => [model.hash, model.name]), this.flight.model?.hash, hash => {
      this.flight.use(models.find(model => model.hash === hash));
      note({ model: hash });
      this.showMarks();
      this.drawCharts();
    });
  }

  /** What a link to another scenario keeps. */
  kept() {
    const { tick, scenario, ...kept } = shown();
    return Object.fromEntries(Object.entries(kept).filter(([name]) => !name.startsWith('centre.')));
  }

  drawCharts() {
    this.readout.drawStrokes();
    this.flown.draw();
    this.charts.draw();
  }

  showLine(one, isShown) {
    one.isShown = isShown;
    note({ lines: this.flight.lines.filter(other => other.isShown).map(other => other.key).join(',') || 'none' });
    this.drawCharts();
  }

  async readOtherPaths() {
    for (const row of this.corpus.scenarios) {
      if (this.signal.aborted) return;
      if (row.id === this.flight.record.id || row.trajectory !== this.flight.record.trajectory) continue;
      try {
        this.flown.add(row.id, await json('/api/path', { scenario: row.id }));
      } catch {
        // The table of scenarios says what is wrong with it.
      }
    }
    if (!this.signal.aborted) this.flown.draw();
  }

  // Ticks.

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

  /** Shows a tick: `pictures` has an image, a playing video or an error for each view. */
  showTick(tick, pictures) {
    this.tick = tick;
    this.pictures.forEach((picture, index) => picture.take(pictures[index]));
    this.showMarks();
    this.slider.value = tick;
    if (document.activeElement !== this.number) this.number.value = tick;
    this.slider.setAttribute('aria-valuetext', this.tickWords(tick));
    this.readout.show(tick);
    const { columns } = this.flight;
    if (columns) {
      this.flown.mark({ along: columns.along_track_m[tick] / METRES_PER_NM, cross: columns.cross_track_m[tick],
        height: columns.height_over_target_m[tick] });
    }
    this.charts.moveTo(tick);
    this.element.dataset.tick = tick;
    if (!this.player.isPlaying) note({ tick });
  }

  tickWords(tick) {
    const { columns } = this.flight;
    if (!columns) return `tick ${tick}`;
    const dtd = columns.dtd_m ? `, ${nauticalMiles(columns.dtd_m[tick])} to touchdown` : '';
    return `tick ${tick}, ${seconds(columns.time_s[tick])}${dtd}`;
  }

  // Pictures.

  showMarks() {
    for (const picture of this.pictures) {
      const { marks, target, words } = this.flight.seen(picture.view.id, this.tick, this.layers);
      Object.assign(picture, { marks, target });
      picture.say(picture.message || words);
      picture.draw();
    }
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
    this.player.refresh();
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
    this.player.refresh();
    if (this.zoom === null) this.setZoom(8);
    this.noteCentres();
  }

  noteCentres() {
    note(Object.fromEntries(this.pictures.map(({ view, centre }) =>
      [`centre.${view.id}`, centre ? `${centre.x.toFixed(1)},${centre.y.toFixed(1)}` : undefined])));
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
