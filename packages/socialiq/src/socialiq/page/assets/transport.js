// Play, pause, step, speed: one clock in sub-steps for all films.

export class Transport {
  /**
   * @param {number} rate Sub-steps of a second.
   * @param {() => void} changed Called whenever the time or the playing has changed.
   */
  constructor(rate, changed) {
    Object.assign(this, { rate, changed, time: 0, end: 0, speed: 1, playing: false, frames: 0 });
  }

  /** Take films of this length; the time stays, as far as they go. */
  load(end) {
    this.end = end;
    this.time = Math.min(this.time, end);
  }

  play() {
    if (this.time >= this.end) this.time = 0;
    this.playing = true;
    this.last = undefined;
    window.requestAnimationFrame((now) => this.tick(now));
    this.changed();
  }

  pause() {
    this.playing = false;
    this.changed();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.end);
    this.changed();
  }

  /** Move by whole decisions of so many sub-steps. */
  step(decisions, frames) {
    this.playing = false;
    this.seek((Math.floor(this.time / frames + (decisions < 0 ? 0.999 : 0)) + decisions) * frames);
  }

  tick(now) {
    if (!this.playing) return;
    const passed = this.last === undefined ? 0 : Math.min(now - this.last, 100);
    this.last = now;
    this.frames += 1;
    this.time += (passed / 1000) * this.rate * this.speed;
    if (this.time >= this.end) {
      this.time = this.end;
      this.playing = false;
    }
    this.changed();
    if (this.playing) window.requestAnimationFrame((next) => this.tick(next));
  }
}
