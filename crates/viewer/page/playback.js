// Pictures of all views in step: those that the server decodes, for each tick that is looked at; and videos, which the browser plays by
// one clock.

import { RequestError } from './dom.js';

/** Memory for decoded pictures, bytes. */
const STILL_BYTES = 240e6;
/** Up to this many pictures a second, of all views, the server's pictures are played. */
const FEW_PICTURES_PER_S = 24;
/** To browsers that can draw coded pictures the server sends only what the screen can show of them; to others, whole bitmaps. */
const HAS_PLANES = 'VideoFrame' in globalThis;
/** Part that a frame of the screen has in the mean distance between two videos: it covers about half a second. */
const SMOOTHING = 0.03;
/** By how much a video that is not in step is faster or slower. */
const CORRECTION = 0.04;
/** Browsers play no faster. */
const MOST_SPEED = 16;
/** A video that is further from the first one goes to its place at once: seconds of a watcher's time, and periods of the pictures. */
const FAR = { s: 0.5, periods: 4 };
const COLOURS = { matrix: 'bt709', primaries: 'bt709', transfer: 'bt709', fullRange: true };

/** A picture from the server: the whole, one column for each `every`, and perhaps a part { image, x, y, width, height } with all. */
class Still {
  constructor(whole, every, part) {
    Object.assign(this, { whole, every, part });
  }

  close() {
    this.whole.close();
    this.part?.image.close();
  }
}

/** Pictures from the server, the last ones kept. */
class Stills {
  constructor(scenario, views) {
    this.scenario = scenario;
    this.kept = new Map();
    const bytes = Math.max(...views.map(view => view.width_px * view.height_px * 4), 1);
    this.most = Math.max(3 * views.length, Math.floor(STILL_BYTES / bytes));
  }

  /** What is needed ({ every, part }) of the picture of a view at a tick, as a promise. */
  at(view, tick, { every, part }) {
    const query = { view, tick, ...HAS_PLANES && { as: 'planes', every, ...part && { part: part.join() } } };
    const key = JSON.stringify(query);
    let picture = this.kept.get(key);
    this.kept.delete(key);
    picture ??= this.fetch(query, every, part).catch(error => {
      this.kept.delete(key);
      throw error;
    });
    this.kept.set(key, picture);
    for (const [oldest, old] of this.kept) {
      if (this.kept.size <= this.most) break;
      this.kept.delete(oldest);
      old.then(still => setTimeout(() => still.close(), 1000), () => {});
    }
    return picture;
  }

  async fetch(query, every, part) {
    let response;
    try {
      response = await fetch(`/frame?${new URLSearchParams({ scenario: this.scenario, ...query })}`);
    } catch {
      throw new RequestError('dtd view does not answer; was it stopped?');
    }
    if (!response.ok) {
      const answer = await response.json().catch(() => ({}));
      throw new RequestError(answer.error ?? `the image cannot be loaded: ${response.status}`);
    }
    const sizes = response.headers.get('picture-size');
    if (!sizes) return new Still(await createImageBitmap(await response.blob(), { colorSpaceConversion: 'none' }), 1, null);
    const bytes = await response.arrayBuffer();
    let begin = 0;
    const [whole, detail] = sizes.split(' ').map(size => {
      const [codedWidth, codedHeight] = size.split('x').map(Number);
      const planes = new Uint8Array(bytes, begin, codedWidth * codedHeight * 3 / 2);
      begin += planes.length;
      return new VideoFrame(planes, { format: 'I420', codedWidth, codedHeight, timestamp: 0, colorSpace: COLOURS });
    });
    const [x, y, width, height] = part ?? [];
    return new Still(whole, every, detail ? { image: detail, x, y, width, height } : null);
  }

  close() {
    for (const old of this.kept.values()) old.then(still => still.close(), () => {});
    this.kept.clear();
  }
}

/** The videos of all views, played by the browser. */
class Videos {
  constructor(scenario, views, rate, show) {
    this.rate = rate;
    this.show = show;
    this.elements = views.map(view => {
      const video = document.createElement('video');
      video.muted = true;
      video.playsInline = true;
      video.preload = 'auto';
      video.setAttribute('aria-hidden', 'true');
      video.tabIndex = -1;
      video.src = `/video?${new URLSearchParams({ scenario, view: view.id })}`;
      return video;
    });
  }

  /** Plays from a tick while `isWanted()`; rejects if this browser cannot, or if it is paused before all videos have begun. */
  async play(tick, speed, isWanted) {
    const period_s = this.rate.denominator / this.rate.numerator;
    await Promise.all(this.elements.map(async video => {
      video.playbackRate = speed;
      video.currentTime = (tick + 0.25) * period_s;
      if (video.readyState < 3 || video.seeking) {
        await new Promise((resolve, reject) => {
          video.addEventListener('canplay', resolve, { once: true });
          video.addEventListener('error', () => reject(video.error), { once: true });
          if (video.error) reject(video.error);
        });
      }
    }));
    if (!isWanted()) return;
    this.speed = speed;
    this.show(tick, this.elements);
    this.watch(isWanted);
    await Promise.all(this.elements.map(video => video.play()));
  }

  /** The first view leads: its pictures say which tick is shown. */
  watch(isWanted) {
    const period_s = this.rate.denominator / this.rate.numerator;
    const far_s = Math.max(FAR.s * this.speed, FAR.periods * period_s);
    const shown_s = this.elements.map(() => null);
    const [leader, ...others] = this.elements.map((video, index) => {
      const presented = (_now, { mediaTime }) => {
        shown_s[index] = mediaTime;
        if (isWanted()) video.requestVideoFrameCallback(presented);
      };
      video.requestVideoFrameCallback(presented);
      return index;
    });
    const behind_s = others.map(() => 0);
    let tick = null;
    const frame = () => {
      if (!isWanted()) return;
      requestAnimationFrame(frame);
      if (shown_s.includes(null)) return;
      const latest = Math.round(shown_s[leader] * this.rate.numerator / this.rate.denominator);
      if (latest !== tick) this.show(latest, this.elements);
      tick = latest;
      others.forEach((index, number) => {
        const video = this.elements[index];
        if (video.seeking) return;
        behind_s[number] += (shown_s[leader] - shown_s[index] - behind_s[number]) * SMOOTHING;
        if (Math.abs(behind_s[number]) > far_s) {
          video.currentTime = this.elements[leader].currentTime;
          behind_s[number] = 0;
        }
        this.keepInStep(video, behind_s[number]);
      });
    };
    requestAnimationFrame(frame);
  }

  /**
   * A video whose pictures come late runs a little faster for a while, and an early one slower. What decides is its pictures: times that a
   * video states (`currentTime`) are up to two pictures off.
   */
  keepInStep(video, behind_s) {
    const period_s = this.rate.denominator / this.rate.numerator;
    const isCorrected = video.playbackRate !== this.speed;
    const correction = Math.abs(behind_s) < period_s * (isCorrected ? 0.1 : 0.35) ? 0 : Math.sign(behind_s) * CORRECTION;
    video.playbackRate = Math.min(MOST_SPEED, this.speed * (1 + correction));
  }

  get hasEnded() {
    return this.elements.some(video => video.ended);
  }

  pause() {
    for (const video of this.elements) video.pause();
  }

  close() {
    this.pause();
    for (const video of this.elements) {
      video.removeAttribute('src');
      video.load();
    }
  }
}

/**
 * Shows ticks. `show(tick, pictures)` is told each one, with a picture, a playing video or an error for each view; `need(index, tick)` says what
 * the screen shows of a view.
 */
export class Player {
  constructor({ scenario, views, rate, ticks, need, show, changed }) {
    Object.assign(this, { scenario, views, rate, ticks, need, show, changed });
    this.stills = new Stills(scenario, views);
    this.videos = null;
    this.tick = 0;
    /** Stands for one press of Play; null while paused. What an earlier one has begun finds another here. */
    this.turn = null;
    this.wanted = null;
    /** Of the step that is under way, or was the last one. */
    this.arrival = null;
    this.isStale = false;
    this.closed = false;
  }

  get isPlaying() {
    return this.turn !== null;
  }

  /** Shows exactly this tick. While one is on its way, only the last of further ones is shown. */
  async step(tick) {
    tick = Math.max(0, Math.min(this.ticks - 1, Math.round(tick)));
    const direction = Math.sign(tick - this.tick) || 1;
    const isBusy = this.wanted !== null;
    this.wanted = tick;
    if (isBusy) return;
    this.arrival = this.arrive();
    const shown = await this.arrival;
    if (shown === null) return;
    // The next step will probably go the same way.
    for (const next of [shown + direction, shown + 2 * direction]) {
      if (next >= 0 && next < this.ticks) await this.pictures(next);
      if (this.wanted !== null || this.closed) return;
    }
  }

  /** Shows the wanted tick, also if that changes meanwhile. Returns it, or null if something else is shown instead. */
  async arrive() {
    let shown = null;
    while ((shown !== this.wanted || this.isStale) && !this.closed) {
      this.isStale = false;
      shown = this.wanted;
      const pictures = await this.pictures(shown);
      if (this.closed || this.wanted === null) return null;
      this.tick = shown;
      this.show(shown, pictures);
    }
    this.wanted = null;
    return shown;
  }

  /** A picture or an error for each view. */
  pictures(tick) {
    return Promise.all(this.views.map((view, index) => this.stills.at(view.id, tick, this.need(index, tick)).catch(error => error)));
  }

  /** The screen shows something else of the pictures. */
  refresh() {
    if (this.isPlaying || this.closed) return;
    this.isStale = true;
    if (this.wanted === null) this.step(this.tick);
  }

  async play(speed) {
    const turn = Symbol('turn');
    this.turn = turn;
    const isWanted = () => this.turn === turn;
    this.changed();
    // Playing begins where a step ends that is still under way.
    await this.arrival;
    if (!isWanted()) return;
    if (this.tick >= this.ticks - 1) await this.step(0);
    if (!isWanted()) return;
    const pictures_per_s = this.rate.numerator / this.rate.denominator * speed * this.views.length;
    const isPossible = 'requestVideoFrameCallback' in HTMLVideoElement.prototype;
    if (pictures_per_s > FEW_PICTURES_PER_S && isPossible) {
      try {
        await this.playVideos(speed, isWanted);
        return;
      } catch (error) {
        if (!isWanted()) return;
        console.info('the browser cannot play these videos; single images are played instead', error);
        this.videos?.close();
        this.videos = null;
      }
    }
    await this.playStills(speed, isWanted);
  }

  async playVideos(speed, isWanted) {
    this.videos ??= new Videos(this.scenario, this.views, this.rate, (tick, pictures) => {
      // A step that is still under way comes too late: its pictures would take the place of the videos, which then stop.
      this.wanted = null;
      this.tick = tick;
      this.show(tick, pictures);
    });
    const { videos } = this;
    await videos.play(this.tick, speed, isWanted);
    while (isWanted()) {
      await new Promise(resolve => setTimeout(resolve, 100));
      if (isWanted() && videos.hasEnded) {
        this.pause();
        await this.step(this.ticks - 1);
      }
    }
  }

  async playStills(speed, isWanted) {
    const [from, began] = [this.tick, performance.now()];
    const ticks_per_ms = this.rate.numerator / this.rate.denominator * speed / 1000;
    while (isWanted()) {
      const due = Math.min(this.ticks - 1, from + Math.floor((performance.now() - began) * ticks_per_ms));
      if (due > this.tick) {
        const pictures = await this.pictures(due);
        if (!isWanted()) return;
        this.tick = due;
        this.show(due, pictures);
        if (due + 1 < this.ticks) this.pictures(due + 1);
      }
      if (this.tick >= this.ticks - 1) this.pause();
      await new Promise(requestAnimationFrame);
    }
  }

  pause() {
    if (!this.isPlaying) return;
    this.turn = null;
    this.videos?.pause();
    this.changed();
    this.step(this.tick);
  }

  close() {
    this.closed = true;
    this.turn = null;
    this.videos?.close();
    this.stills.close();
  }
}
