// Pictures of all views in step: exact ones, decoded by the server, for each tick that is looked at; and videos, played by the browser,
// of which a tick is shown only once all views have its picture.

import { RequestError } from './dom.js';

/** Memory for decoded pictures, bytes. */
const STILL_BYTES = 240e6;
/** Up to this many pictures a second, of all views, the server's exact ones are played. */
const FEW_PICTURES_PER_S = 24;
/** Pictures of a video that wait for those of the other views. */
const MOST_WAITING = 6;

/** Pictures from the server, the last ones kept. */
class Stills {
  constructor(scenario, views) {
    this.scenario = scenario;
    this.kept = new Map();
    const bytes = Math.max(...views.map(view => view.width_px * view.height_px * 4), 1);
    this.most = Math.max(3 * views.length, Math.floor(STILL_BYTES / bytes));
  }

  /** The picture of a view at a tick, as a promise. */
  at(view, tick) {
    const key = `${tick} ${view}`;
    let picture = this.kept.get(key);
    this.kept.delete(key);
    picture ??= this.fetch(view, tick).catch(error => {
      this.kept.delete(key);
      throw error;
    });
    this.kept.set(key, picture);
    for (const [oldest, old] of this.kept) {
      if (this.kept.size <= this.most) break;
      this.kept.delete(oldest);
      old.then(bitmap => setTimeout(() => bitmap.close(), 1000), () => {});
    }
    return picture;
  }

  async fetch(view, tick) {
    const query = new URLSearchParams({ scenario: this.scenario, view, tick });
    let response;
    try {
      response = await fetch(`/frame?${query}`);
    } catch {
      throw new RequestError('dtd view does not answer; was it stopped?');
    }
    if (!response.ok) {
      const answer = await response.json().catch(() => ({}));
      throw new RequestError(answer.error ?? `the picture cannot be had: ${response.status}`);
    }
    return createImageBitmap(await response.blob(), { colorSpaceConversion: 'none' });
  }

  close() {
    for (const old of this.kept.values()) old.then(bitmap => bitmap.close(), () => {});
    this.kept.clear();
  }
}

/** The videos of all views, played by the browser. */
class Videos {
  constructor(scenario, views, rate, show) {
    this.rate = rate;
    this.show = show;
    this.waiting = new Map(views.map(view => [view.id, new Map()]));
    this.elements = views.map(view => {
      const video = document.createElement('video');
      video.muted = true;
      video.playsInline = true;
      video.preload = 'auto';
      video.className = 'playing';
      video.setAttribute('aria-hidden', 'true');
      video.tabIndex = -1;
      video.src = `/video?${new URLSearchParams({ scenario, view: view.id })}`;
      document.body.append(video);
      return video;
    });
    this.ids = views.map(view => view.id);
  }

  /** Plays from a tick; rejects if this browser cannot. */
  async play(tick, speed) {
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
    this.speed = speed;
    this.isPlaying = true;
    this.elements.forEach((video, index) => this.watch(video, this.ids[index]));
    await Promise.all(this.elements.map(video => video.play()));
  }

  watch(video, id) {
    const presented = (_now, { mediaTime }) => {
      if (!this.isPlaying) return;
      const tick = Math.round(mediaTime * this.rate.numerator / this.rate.denominator);
      const waiting = this.waiting.get(id);
      waiting.get(tick)?.close();
      waiting.set(tick, new VideoFrame(video));
      while (waiting.size > MOST_WAITING) this.drop(waiting, waiting.keys().next().value);
      this.compose();
      this.keepInStep();
      video.requestVideoFrameCallback(presented);
    };
    video.requestVideoFrameCallback(presented);
  }

  /** Shows the latest tick that all views have. */
  compose() {
    const [first, ...others] = this.waiting.values();
    const common = [...first.keys()].filter(tick => others.every(other => other.has(tick)));
    if (!common.length) return;
    const tick = Math.max(...common);
    this.show(tick, this.ids.map(id => this.waiting.get(id).get(tick)));
    for (const waiting of this.waiting.values()) {
      for (const old of [...waiting.keys()]) if (old <= tick) this.drop(waiting, old);
    }
  }

  drop(waiting, tick) {
    waiting.get(tick).close();
    waiting.delete(tick);
  }

  /** The first view leads; the others run a little faster or slower. */
  keepInStep() {
    const [leader, ...others] = this.elements;
    const period_s = this.rate.denominator / this.rate.numerator;
    for (const video of others) {
      const behind_s = leader.currentTime - video.currentTime;
      if (Math.abs(behind_s) > Math.max(0.5, 4 * period_s)) video.currentTime = leader.currentTime;
      const nudge = Math.abs(behind_s) < period_s / 3 ? 0 : Math.max(-0.1, Math.min(0.1, behind_s));
      const speed = this.speed * (1 + nudge);
      if (Math.abs(video.playbackRate - speed) > 0.005) video.playbackRate = speed;
    }
  }

  get hasEnded() {
    return this.elements.some(video => video.ended);
  }

  pause() {
    this.isPlaying = false;
    for (const video of this.elements) video.pause();
    for (const waiting of this.waiting.values()) {
      for (const old of [...waiting.keys()]) this.drop(waiting, old);
    }
  }

  close() {
    this.pause();
    for (const video of this.elements) {
      video.removeAttribute('src');
      video.load();
      video.remove();
    }
  }
}

/** Shows ticks. `show(tick, pictures)` is told each one, with an image or an error for each view. */
export class Player {
  constructor({ scenario, views, rate, ticks, show, changed }) {
    Object.assign(this, { scenario, views, rate, ticks, show, changed });
    this.stills = new Stills(scenario, views);
    this.videos = null;
    this.tick = 0;
    this.isPlaying = false;
    this.wanted = null;
    this.closed = false;
  }

  /** Shows exactly this tick. While one is on its way, only the last of further ones is shown. */
  async step(tick) {
    tick = Math.max(0, Math.min(this.ticks - 1, Math.round(tick)));
    const direction = Math.sign(tick - this.tick) || 1;
    const isBusy = this.wanted !== null;
    this.wanted = tick;
    if (isBusy) return;
    let shown = null;
    while (shown !== this.wanted && !this.closed) {
      shown = this.wanted;
      const pictures = await this.pictures(shown);
      if (this.closed) return;
      this.tick = shown;
      this.show(shown, pictures);
    }
    this.wanted = null;
    // The next step will probably go the same way.
    for (const next of [shown + direction, shown + 2 * direction]) {
      if (next >= 0 && next < this.ticks) await this.pictures(next);
      if (this.wanted !== null || this.closed) return;
    }
  }

  /** An image or an error for each view. */
  pictures(tick) {
    return Promise.all(this.views.map(view => this.stills.at(view.id, tick).catch(error => error)));
  }

  async play(speed) {
    this.isPlaying = true;
    this.changed();
    if (this.tick >= this.ticks - 1) await this.step(0);
    const pictures_per_s = this.rate.numerator / this.rate.denominator * speed * this.views.length;
    const isPossible = 'requestVideoFrameCallback' in HTMLVideoElement.prototype && 'VideoFrame' in globalThis;
    if (pictures_per_s > FEW_PICTURES_PER_S && isPossible) {
      try {
        await this.playVideos(speed);
        return;
      } catch (error) {
        console.info('the browser cannot play these videos; single pictures are played instead', error);
        this.videos?.close();
        this.videos = null;
      }
    }
    await this.playStills(speed);
  }

  async playVideos(speed) {
    this.videos ??= new Videos(this.scenario, this.views, this.rate, (tick, pictures) => {
      if (!this.isPlaying) return;
      this.tick = tick;
      this.show(tick, pictures);
    });
    const { videos } = this;
    await videos.play(this.tick, speed);
    while (this.isPlaying && !this.closed) {
      await new Promise(resolve => setTimeout(resolve, 100));
      if (videos.hasEnded) {
        this.pause();
        await this.step(this.ticks - 1);
      }
    }
  }

  async playStills(speed) {
    const [from, began] = [this.tick, performance.now()];
    const ticks_per_ms = this.rate.numerator / this.rate.denominator * speed / 1000;
    while (this.isPlaying && !this.closed) {
      const due = Math.min(this.ticks - 1, from + Math.floor((performance.now() - began) * ticks_per_ms));
      if (due > this.tick) {
        const pictures = await this.pictures(due);
        if (!this.isPlaying || this.closed) return;
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
    this.isPlaying = false;
    this.videos?.pause();
    this.changed();
    this.step(this.tick);
  }

  close() {
    this.closed = true;
    this.isPlaying = false;
    this.videos?.close();
    this.stills.close();
  }
}
