// Map and profile of flown paths about the touchdown target.

import { LineChart, range } from './chart.js';
import { colour } from './colours.js';
import { element } from './dom.js';
import { METRES_PER_NM } from './units.js';

const GLIDE_PATH_DEG = 3;

/** Two charts over the remaining distance along the course: offset from the centreline, and height. */
export class FlownPaths {
  constructor({ height = 190, onpick, onpoint } = {}) {
    this.map = new LineChart({ title: 'Map: right of the centreline', unit: 'm', height, bottom: false,
      label: 'Map of the flown paths: offset from the extended centreline over the distance along the course' });
    this.profile = new LineChart({ title: 'Profile: height over the touchdown target', unit: 'm', height: height + 18,
      label: 'Profile of the flown paths: height over the distance along the course' });
    this.paths = new Map();
    this.shown = () => true;
    this.chosen = null;
    /** Colour and dash of a path. */
    this.style = id => ({ colour: colour(id === this.chosen ? 'accent' : 'edge'), dash: [] });
    this.at = null;
    this.glide_path_deg = GLIDE_PATH_DEG;
    this.element = element('div', { class: 'flown' }, this.map.canvas, this.profile.canvas,
      element('p', { class: 'axis' }, 'distance along the course to the touchdown target, NM'));
    for (const chart of [this.map, this.profile]) {
      chart.onpick = (_x, event) => {
        const id = this.nearest(chart, event);
        if (id !== null) onpick?.(id);
      };
      if (onpoint) {
        chart.onpoint = (_x, event) => onpoint(this.nearest(chart, event));
        chart.canvas.addEventListener('pointerleave', () => onpoint(null));
      }
    }
    if (onpick) this.element.classList.add('pickable');
  }

  /** Adds a path: columns along_track_m, cross_track_m, height_over_target_m. */
  add(id, path) {
    this.paths.set(id, {
      along: path.along_track_m.map(metres => metres / METRES_PER_NM),
      cross: path.cross_track_m,
      height: path.height_over_target_m,
    });
  }

  nearest(chart, event) {
    const key = chart === this.map ? 'cross' : 'height';
    let best = [null, 14];
    for (const [id, path] of this.paths) {
      if (!this.shown(id)) continue;
      path.along.forEach((along, index) => {
        const away = Math.hypot(chart.screenX(along) - event.offsetX, chart.screenY(path[key][index]) - event.offsetY);
        if (away < best[1]) best = [id, away];
      });
    }
    return best[0];
  }

  draw() {
    const shown = [...this.paths].filter(([id]) => this.shown(id));
    const alongs = shown.flatMap(([, path]) => [Math.max(...path.along), Math.min(...path.along)]);
    const [low, high] = alongs.length ? range(alongs, 0.02) : [-0.5, 10];
    for (const [chart, key] of [[this.map, 'cross'], [this.profile, 'height']]) {
      // Aircraft fly from left to right.
      chart.x = [high, low];
      const values = shown.flatMap(([, path]) => path[key]);
      chart.y = range(values.length ? [...values, 0] : [-1, 1]);
      chart.lines = shown.map(([id, path]) => ({ x: path.along, y: path[key], width: id === this.chosen ? 3.5 : 1.5, ...this.style(id) }));
      // The chosen path is on top of the others.
      chart.lines.sort((one, other) => one.width - other.width);
      chart.marks = [{ x: 0, y: 0, colour: colour('ink') }];
    }
    const glide_m = distance_nm => distance_nm * METRES_PER_NM * Math.tan(this.glide_path_deg * Math.PI / 180);
    this.profile.lines.unshift({ x: [high, 0], y: [glide_m(high), 0], colour: colour('quiet'), dash: [3, 4], width: 1 });
    this.map.lines.unshift({ x: [high, 0], y: [0, 0], colour: colour('quiet'), dash: [3, 4], width: 1 });
    this.map.draw();
    this.profile.draw();
    this.mark(this.at);
  }

  /** Marks where the aircraft is. */
  mark(at) {
    this.at = at;
    for (const [chart, key] of [[this.map, 'cross'], [this.profile, 'height']]) {
      chart.marks.length = Math.min(1, chart.marks.length);
      if (at) chart.marks.push({ x: at.along, y: at[key], colour: colour('accent') });
      chart.point();
    }
  }
}
