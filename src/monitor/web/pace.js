/**
 * How finely clay is drawn while it or the camera moves: where a picture in full takes long, as without a graphics card, at less resolution, until nothing has
 * changed for a while.
 */

/** A picture in full that takes longer is too slow to move: it misses two of three frames of the screen. */
const SLOW_MS = 40;
/** What a picture may take while something moves: less than a frame of the screen, as the browser has to show it too. */
const AIM_MS = 12;
const STILL_MS = 200;
/** Of the resolution: at least so much, in steps, as every other size takes new buffers. */
const LEAST = 0.3;
const STEP = 0.1;

export class Pace {
  /** @param {() => void} redraw called when what has come to rest is to be drawn in full */
  constructor(redraw) {
    this.redraw = redraw;
    this.forget();
  }

  /** Times of a graphics card that is gone. */
  forget() {
    /** How long the last pictures in full took, ms, without the first: a program is only finished by the driver when something is drawn with it. */
    this.took_ms = [];
    this.isFirst = true;
    this.key = "";
    this.changedAt = -Infinity;
  }

  /** Share of the full resolution for the next picture. @param {string} key another one means: it shows something else */
  share(key) {
    const now = performance.now();
    if (key !== this.key) [this.key, this.changedAt] = [key, now];
    // A picture may take long by chance: the shorter one of two counts.
    const took_ms = Math.min(...this.took_ms);
    clearTimeout(this.timer);
    if (this.took_ms.length === 0 || took_ms < SLOW_MS || now - this.changedAt >= STILL_MS) return 1;
    this.timer = setTimeout(this.redraw, STILL_MS);
    return Math.max(LEAST, STEP * Math.floor(Math.sqrt(AIM_MS / took_ms) / STEP));
  }

  /** Takes the time until all that was drawn is there. @param {WebGL2RenderingContext} gl @param {number} begun when drawing began, ms */
  time(gl, begun) {
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    if (!fence) return;
    const look = () => {
      if (gl.isContextLost()) return;
      if (gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) {
        setTimeout(look, 4);
        return;
      }
      gl.deleteSync(fence);
      if (!this.isFirst) this.took_ms = [...this.took_ms.slice(-1), performance.now() - begun];
      this.isFirst = false;
    };
    setTimeout(look, 4);
  }
}
