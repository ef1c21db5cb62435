// Thumbnails of scenarios: asked for when their place comes into view, two at a time, so that other requests find a connection.

import { element } from './dom.js';

const AT_ONCE = 2;
/** Places this far outside of the window are filled already. */
const AHEAD = '300px';

/** The thumbnails of a page; `signal` ends them. */
export class Thumbnails {
  constructor(signal) {
    this.signal = signal;
    /** Places by scenario: { place, state }. */
    this.places = new Map();
    this.queue = [];
    this.running = 0;
    this.observer = new IntersectionObserver(entries => this.onsight(entries), { rootMargin: AHEAD });
    this.addresses = [];
    signal.addEventListener('abort', () => {
      this.observer.disconnect();
      this.addresses.forEach(address => URL.revokeObjectURL(address));
    });
  }

  /** The place of a scenario's picture, the same one as long as its state is the same. `words` stand there without a picture. */
  of({ id, state }, isThere, words) {
    const known = this.places.get(id);
    if (known?.state === state) {
      if (!isThere) known.place.textContent = words;
      return known.place;
    }
    const place = element('div', { class: 'thumbnail', 'data-scenario': id }, isThere ? '' : words);
    this.places.set(id, { place, state });
    if (isThere) this.observer.observe(place);
    return place;
  }

  onsight(entries) {
    for (const { isIntersecting, target } of entries) {
      const waiting = this.queue.indexOf(target);
      // A place that was scrolled past gives way to those in view.
      if (waiting >= 0) this.queue.splice(waiting, 1);
      if (isIntersecting) this.queue.push(target);
    }
    while (this.running < AT_ONCE && this.queue.length) this.fill(this.queue.shift());
  }

  async fill(place) {
    this.observer.unobserve(place);
    this.running += 1;
    try {
      const response = await fetch(`/thumbnail?${new URLSearchParams({ scenario: place.dataset.scenario })}`, { signal: this.signal });
      if (!response.ok) throw new Error((await response.json()).error);
      const address = URL.createObjectURL(await response.blob());
      this.addresses.push(address);
      place.replaceChildren(element('img', { src: address, alt: '' }));
    } catch (error) {
      place.textContent = 'no image';
      place.title = error.message;
    }
    this.running -= 1;
    if (this.queue.length && !this.signal.aborted) this.fill(this.queue.shift());
  }
}
