// How a rider moves through a menu with one switch, two switches or a joystick. Pure: presses and times in, moves out.
//
// Methods: "auto" (a frame sweeps, a press takes), "step" (switch 1 is next, switch 2 takes), "single" (a short press is next,
// a long one takes), "inverse" (the frame sweeps while the switch is held, letting go takes), "direct" (joystick, keys, touch).

export const METHODS = {
  auto: "One switch: the frame moves, a press takes",
  step: "Two switches: next, and take",
  single: "One switch: short is next, long takes",
  inverse: "One switch: hold to move, let go to take",
  direct: "Joystick, keys or touch",
};

/** Options in seconds but for `rounds`: [default, least, most, step]. The sweep's range is that of the spec (0.3 to 5 s). */
export const OPTIONS = {
  sweep: [1.5, 0.3, 5, 0.1],
  first: [0.5, 0, 3, 0.1], // the first item of a menu is longer by this
  acceptance: [0, 0, 1, 0.1], // a press counts once it has lasted so long
  release: [0.2, 0, 2, 0.1], // after a press no other one counts for so long
  long: [0.8, 0.4, 3, 0.1], // a press of the method "single" takes from this length on
  rounds: [2, 1, 9, 1], // rounds without a press, after which the frame rests
};

export const BOUNCE_S = 0.03; // edges closer than this are one: switches bounce for 5 to 20 ms
export const STUCK_S = 10; // a switch held for longer is stuck, but for "inverse", where it may be held for a whole menu
const CHATTER = 16; // presses within two seconds; the fastest fingers tap seven times a second
const CHATTER_S = 2;

export function defaults() {
  return { method: "auto", ...Object.fromEntries(Object.entries(OPTIONS).map(([name, [value]]) => [name, value])) };
}

/** The options of a browser's memory, each one within its limits; damaged ones are the defaults. */
export function sound(kept) {
  const found = defaults();
  if (kept === null || typeof kept !== "object") return found;
  if (kept.method in METHODS) found.method = kept.method;
  for (const [name, [, least, most]] of Object.entries(OPTIONS)) {
    if (typeof kept[name] === "number" && kept[name] >= least && kept[name] <= most) found[name] = kept[name];
  }
  return found;
}

/**
 * The state of a rider's access to a menu. `count` is the number of its items; `index` is the framed one, -1 while the frame
 * rests. `level`, `tick` and `step` take times [s] of one clock and return moves in order: "next", "take", "back", "rest", "wake",
 * "stuck", "chatter".
 */
export class Access {
  constructor(options) {
    this.options = options;
    this.count = 0;
    this.index = -1;
    this.round = 0;
    this.due = Infinity; // time of the next move of the frame
    this.levels = new Map(); // switch: whether its contact is closed, bounces and all
    this.held = new Map(); // switch: time since which it is down
    this.edges = new Map(); // switch: time of its latest edge that counted
    this.used = true; // the press that is held has done its work
    this.told = false; // that the switch is stuck
    this.ready = -Infinity; // presses count from this time on
    this.presses = [];
  }

  get sweeps() {
    return this.options.method === "auto" || (this.options.method === "inverse" && this.held.size > 0 && !this.used);
  }

  /** A new menu of `count` items begins; its first item is framed. A press that is still held does not count in it. */
  begin(count, now) {
    [this.count, this.round, this.used] = [count, 0, true];
    this.index = count && this.options.method !== "inverse" ? 0 : -1;
    this.due = this.options.method === "auto" ? now + this.options.sweep + this.options.first : Infinity;
  }

  /** The frame waits: its item is being spoken. */
  wait(now) {
    if (this.due !== Infinity) this.due = Math.max(this.due, now + this.options.sweep);
  }

  /** A switch closes, and its press has done its work elsewhere. */
  ignore(which, now) {
    this.levels.set(which, true);
    this.edges.set(which, now);
    this.held.set(which, now);
    [this.used, this.told] = [true, false];
  }

  /** A switch's contact closes or opens. */
  level(which, closed, now) {
    this.levels.set(which, closed);
    return this.settled(which, now);
  }

  /** Time passes. */
  tick(now) {
    const moves = [...this.levels.keys()].flatMap((which) => this.settled(which, now));
    const lasted = now - Math.min(Infinity, ...this.held.values());
    if (lasted > STUCK_S && !this.told && this.options.method !== "inverse") {
      this.told = true;
      return [...moves, "stuck"];
    }
    if (!this.used && lasted >= 0) moves.push(...this.lasted(lasted, now));
    if (this.sweeps && now >= this.due) moves.push(...this.next(now));
    return moves;
  }

  /** A step by joystick or keys: "next", "previous", "take" or "back"; from rest the first one wakes the frame. */
  step(move, now) {
    if (this.index < 0 && this.count) return this.wake(now);
    if (move === "next") return this.next(now);
    if (move !== "previous") return [move];
    this.index = (this.index + this.count - 1) % this.count;
    return ["next"];
  }

  settled(which, now) {
    const closed = this.levels.get(which);
    if (closed === this.held.has(which) || now - (this.edges.get(which) ?? -Infinity) < BOUNCE_S) return [];
    this.edges.set(which, now);
    return closed ? this.pressed(which, now) : this.released(which, now);
  }

  pressed(which, now) {
    this.held.set(which, now);
    [this.used, this.told] = [true, false];
    this.presses = [...this.presses.filter((at) => now - at < CHATTER_S), now];
    if (this.presses.length > CHATTER) return ["chatter"];
    if (now < this.ready || !this.count) return [];
    this.used = false;
    if (this.options.method === "inverse") return this.next(now);
    if (this.index < 0) return this.wake(now);
    if (this.options.method === "single" || this.options.acceptance > 0) return [];
    return this.accepted(which, now);
  }

  released(which, now) {
    this.held.delete(which);
    this.ready = now + this.options.release;
    if (this.used) return [];
    this.used = true;
    if (this.options.method === "single") return this.next(now);
    return this.options.method === "inverse" && this.index >= 0 ? this.take() : [];
  }

  /** The work of a press that counts only after some time. */
  lasted(lasted, now) {
    const { method, long, acceptance } = this.options;
    if (method === "single" && lasted >= long) return this.take();
    if (!["auto", "step", "direct"].includes(method) || lasted < acceptance) return [];
    return this.accepted([...this.held.keys()][0], now);
  }

  accepted(which, now) {
    this.used = true;
    return this.options.method === "step" && which === 1 ? this.next(now) : this.take();
  }

  take() {
    [this.used, this.due] = [true, Infinity]; // until the next menu begins
    return ["take"];
  }

  wake(now) {
    this.begin(this.count, now);
    return ["wake"];
  }

  /** The frame moves on; after the last item it begins a new round, and after the last round it rests. */
  next(now) {
    this.index += 1;
    if (this.index >= this.count) {
      [this.index, this.round] = [0, this.round + 1];
      if (this.sweeps && this.round >= this.options.rounds) {
        [this.index, this.round, this.due, this.used] = [-1, 0, Infinity, true];
        return ["rest"];
      }
    }
    this.due = this.sweeps ? now + this.options.sweep + (this.index === 0 ? this.options.first : 0) : Infinity;
    return ["next"];
  }
}

const STUDENT = [0, 0, 6.31, 2.92, 2.35, 2.13, 2.02, 1.94, 1.89, 1.86, 1.83, 1.81]; // 95 % one-sided, by the number of presses

/**
 * The sweep time [s] for a rider whose presses came `times` [s] after the frame: the mean divided by 0.65 (Simpson, Koester and
 * LoPresti 2006), and long enough for 95 % of this rider's presses by their own spread. In steps of 0.1 s, within the limits.
 */
export function proposedSweep(times) {
  const known = times.filter((time) => Number.isFinite(time) && time > 0);
  if (known.length < 3) return OPTIONS.sweep[0];
  const mean = known.reduce((sum, time) => sum + time, 0) / known.length;
  const spread = Math.sqrt(known.reduce((sum, time) => sum + (time - mean) ** 2, 0) / (known.length - 1));
  const quantile = STUDENT[known.length] ?? 1.75;
  const wanted = Math.max(mean / 0.65, mean + quantile * spread * Math.sqrt(1 + 1 / known.length));
  const [, least, most, step] = OPTIONS.sweep;
  return Math.min(most, Math.max(least, Number((Math.ceil(wanted / step - 1e-9) * step).toFixed(1))));
}
