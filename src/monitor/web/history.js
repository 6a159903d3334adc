/** The last rows of the loop, oldest overwritten first. */

/** Ten seconds of what the server sends at most: at 60 messages a second up to 100 rows each. */
const ROWS = 1 << 16;
/** Numbers of a row of the state's `history`: `[time_s, force_n, depth_mm, compute_us, wakeup_us]`. */
const WIDTH = 5;

export class History {
  constructor() {
    this.rows = new Float64Array(ROWS * WIDTH);
    this.clear();
  }

  clear() {
    this.n = 0;
  }

  /** Time of the newest row, s. */
  get end() {
    return this.n === 0 ? 0 : this.at(this.n - 1, 0);
  }

  /** Row of the oldest that is kept. */
  get first() {
    return Math.max(0, this.n - ROWS);
  }

  /** @param {number} row @param {number} column */
  at(row, column) {
    return this.rows[(row % ROWS) * WIDTH + column];
  }

  /** @param {(?number)[][]} rows */
  push(rows) {
    for (const row of rows) {
      // A loop that began anew has a time of its own.
      if (row[0] < this.end) this.clear();
      for (let n = 0; n < WIDTH; n += 1) this.rows[(this.n % ROWS) * WIDTH + n] = row[n] ?? Number.NaN;
      this.n += 1;
    }
  }

  /** The first row at or after a time; rows are in the order of time. @param {number} time_s */
  since(time_s) {
    let [low, high] = [this.first, this.n];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.at(middle, 0) < time_s) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** A copy that stands still. */
  freeze() {
    const copy = new History();
    copy.rows.set(this.rows);
    copy.n = this.n;
    return copy;
  }
}
