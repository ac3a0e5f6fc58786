// The differences to the experiment: one tree of paths and values, its history, and the fragment of the address that holds it.
// @ts-check

/** @typedef {{px: number[], mm: number[]}} Frame columns and rows, and the size of the sensor */
/** @typedef {{rectangle_px?: number[], polygon_px?: number[][], part?: string, frame?: Frame} | null} Place
 *   part: whose pixels count, "" for all; frame: of which the pixels are */
/** @typedef {{set: Record<string, string>, place: Place}} Differences */

const MOST_STEPS = 200;
/** Longest pause between keys that are one step of undo, ms. */
const ONE_STEP = 1200;

export class Changes {
  constructor() {
    /** @type {Differences} */
    this.now = { set: {}, place: null };
    /** @type {string[]} */
    this.past = [];
    /** @type {string[]} */
    this.future = [];
    /** What is shown: capture and view; no difference to the experiment, but part of the address. */
    this.shown = { capture: "", view: "developed" };
    /** Changes of the picture that is kept to compare with; `null` where none is. @type {string[] | null} */
    this.kept = null;
    this.last = { what: "", time: 0 };
    /** @type {(what: "set" | "place") => void} */
    this.onchange = () => {};
    /** Hears that the part of a region was found. */
    this.onsettled = () => {};
    /** Makes the part that a pixel shows the region. @type {(place: number[]) => void} */
    this.pick = () => {};
  }

  /** Changes as `--set` has them. */
  list() {
    return Object.entries(this.now.set).map(([path, value]) => `${path}=${value}`);
  }

  /** @param {string} path */
  value(path) {
    return this.now.set[path];
  }

  /** Remembers what is there, for undo: once before a change, a whole drag, or a run of keys that `what` names.
   * @param {string} [what] */
  remember(what = "") {
    const now = Date.now();
    const goesOn = what !== "" && what === this.last.what && now - this.last.time < ONE_STEP;
    this.last = { what, time: now };
    if (goesOn) return;
    const text = JSON.stringify(this.now);
    if (this.past.at(-1) !== text) this.past.push(text);
    if (this.past.length > MOST_STEPS) this.past.shift();
    this.future = [];
  }

  /** @param {string} path @param {string | undefined} value `undefined` takes the change away. */
  set(path, value) {
    const set = { ...this.now.set };
    if (value === undefined) delete set[path];
    else set[path] = value;
    this.now = { ...this.now, set };
    this.onchange("set");
  }

  /** @param {Place} place */
  draw(place) {
    this.remember();
    this.now = { ...this.now, place };
    this.onchange("place");
  }

  /** Keeps the part that the server found for a region: no step of its own. @param {string} part */
  settle(part) {
    if (!this.now.place || this.now.place.part !== undefined) return;
    this.now = { ...this.now, place: { ...this.now.place, part } };
    this.onsettled();
  }

  /** The region as the server takes it. */
  place() {
    if (!this.now.place) return null;
    const { frame, ...place } = this.now.place;
    return place;
  }

  /** Moves a region along when the frame is that of another sensor: it stays where it is on the film. @param {Frame} frame */
  fit(frame) {
    const { place } = this.now;
    if (!place) return;
    const of = place.frame ?? frame;
    const move = (/** @type {number} */ value, /** @type {number} */ axis) =>
      (((value / of.px[axis] - 0.5) * of.mm[axis]) / frame.mm[axis] + 0.5) * frame.px[axis];
    const moved = { ...place, frame };
    if (JSON.stringify(of) !== JSON.stringify(frame)) {
      moved.polygon_px = place.polygon_px?.map((corner) => corner.map((value, axis) => Math.round(10 * move(value, axis)) / 10));
      moved.rectangle_px = place.rectangle_px && rectangleOf(place.rectangle_px, move, frame.px);
    }
    this.now = { ...this.now, place: moved };
  }

  reset() {
    this.remember();
    this.now = { set: {}, place: null };
    this.onchange("set");
  }

  undo() {
    this.step(this.past, this.future);
  }

  redo() {
    this.step(this.future, this.past);
  }

  /** @param {string[]} from @param {string[]} to */
  step(from, to) {
    const now = JSON.stringify(this.now);
    let text = from.pop();
    while (text === now) text = from.pop();
    if (text === undefined) return;
    to.push(now);
    this.now = JSON.parse(text);
    this.onchange("set");
  }

  get canUndo() {
    const now = JSON.stringify(this.now);
    return this.past.some((text) => text !== now);
  }

  /** The fragment of an address that opens the workbench as it is now. */
  fragment() {
    const text = new URLSearchParams();
    for (const change of this.list()) text.append("set", change);
    const { place } = this.now;
    const shape = place?.polygon_px ?? place?.rectangle_px;
    if (shape) text.append("region", JSON.stringify(shape));
    if (place?.part !== undefined) text.append("part", place.part);
    if (this.shown.capture) text.append("capture", this.shown.capture);
    if (this.shown.view !== "developed") text.append("view", this.shown.view);
    if (this.kept) text.append("kept", JSON.stringify(this.kept));
    return text.toString();
  }

  /** @param {string} fragment */
  read(fragment) {
    const text = new URLSearchParams(fragment.replace(/^#/, ""));
    /** @type {Record<string, string>} */
    const set = {};
    for (const change of text.getAll("set")) {
      const at = change.indexOf("=");
      if (at > 0) set[change.slice(0, at)] = change.slice(at + 1);
    }
    this.now = { set, place: placeOf(text.get("region"), text.get("part")) };
    this.shown = { capture: text.get("capture") ?? "", view: text.get("view") ?? "developed" };
    this.kept = listOf(text.get("kept"));
  }
}

/** A rectangle whose ends are moved, as far as it lies on the frame.
 * @param {number[]} rectangle @param {(value: number, axis: number) => number} move @param {number[]} px */
function rectangleOf(rectangle, move, px) {
  const ends = [0, 1].map((axis) => [rectangle[axis], rectangle[axis] + rectangle[axis + 2]].map((end) =>
    Math.min(Math.max(Math.round(move(end, axis)), 0), px[axis])));
  const starts = ends.map(([start], axis) => Math.min(start, px[axis] - 1));
  return [...starts, ...ends.map(([, end], axis) => Math.max(end - starts[axis], 1))];
}

/** @param {string | null} text @returns {any[] | null} */
function listOf(text) {
  try {
    const list = JSON.parse(text ?? "null");
    return Array.isArray(list) ? list : null;
  } catch {
    return null;
  }
}

/** @param {string | null} text @param {string | null} part @returns {Place} */
function placeOf(text, part) {
  const numbers = listOf(text);
  if (!numbers) return part ? { part } : null;
  const shape = Array.isArray(numbers[0]) ? { polygon_px: numbers } : { rectangle_px: numbers };
  return part === null ? shape : { ...shape, part };
}
