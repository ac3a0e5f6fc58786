// The frame: asks the server for pictures, the newest wish first, and lets a region be drawn on them.
// @ts-check
import { shortNumber } from "./chart.js";
import { make } from "./controls.js";

/** @typedef {import("./changes.js").Changes} Changes */
/** @typedef {import("./changes.js").Place} Place */

/** @param {string} path @param {object} body @param {AbortSignal} [signal] takes the question back, and the server ends its work */
export async function ask(path, body, signal) {
  const response = await fetch(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body), signal });
  if (response.ok) return response;
  const text = await response.text();
  let told = { error: text.trim(), needs_render: false };
  try {
    told = JSON.parse(text);
  } catch { /* it is plain text */ }
  throw Object.assign(new Error(told.error), { needsRender: told.needs_render });
}

/** Asks for a picture and draws it on a canvas; returns what is told beside it.
 * @param {object} body @param {HTMLCanvasElement} canvas @param {string} [path] @param {AbortSignal} [signal] */
export async function draw(body, canvas, path = "/api/picture", signal) {
  const bytes = await (await ask(path, body, signal)).arrayBuffer();
  const length = new DataView(bytes).getUint32(0, true);
  const facts = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  const image = await createImageBitmap(new Blob([new Uint8Array(bytes, 4 + length)], { type: "image/png" }));
  if (canvas.width !== image.width || canvas.height !== image.height) [canvas.width, canvas.height] = [image.width, image.height];
  canvas.getContext("2d")?.drawImage(image, 0, 0);
  image.close();
  return facts;
}

/** Time from which a picture that nobody wants any more is taken back, and that which a whole one may take while a control is dragged, ms. */
const SLOW = 250;
const SOON = 60;
/** Height of a page beside the frame, and the least of a frame, px. */
const OTHER_HEIGHT = 300;
const LEAST_HEIGHT = 300;

const byId = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));

export class Picture {
  /** @param {Changes} changes @param {(text: string, needsRender?: boolean) => void} say */
  constructor(changes, say) {
    this.changes = changes;
    this.say = say;
    this.canvas = byId("picture");
    this.isBusy = false;
    this.isWanted = false;
    /** While a control is dragged its tones are held. */
    this.isHeld = false;
    /** @type {any} */
    this.facts = null;
    this.tones = "";
    this.serial = 0;
    /** Whether the pictures of a drag are coarse: once a whole one took too long. */
    this.isCoarse = false;
    /** When the picture in the making was asked for, and what takes it back. */
    this.asked = 0;
    this.taken = new AbortController();
    /** @type {() => void} */
    this.onshown = () => {};
    /** Whether what is wanted is not rendered, or only coarsely. */
    this.isUnfinished = false;
    /** Hears after each picture whether a render is needed. @type {(isNeeded: boolean) => void} */
    this.onrender = () => {};
    this.zoom = byId("zoom");
    this.zoom.addEventListener("change", () => this.layOut());
    new ResizeObserver(() => this.layOut()).observe(byId("viewport"));
    const bar = /** @type {HTMLElement} */ (document.querySelector(".bar"));
    new ResizeObserver(() => byId("stage").style.setProperty("--bar-height", `${bar.offsetHeight + 20}px`)).observe(bar);
  }

  /** Asks for a new picture; while one is in the making, for the newest after it. */
  async refresh() {
    this.isWanted = true;
    // A drag shows what there was time for; otherwise a slow picture would only be late
    if (this.isBusy && !this.isHeld && performance.now() - this.asked > SLOW) this.taken.abort();
    if (this.isBusy) return;
    this.isBusy = true;
    byId("viewport").setAttribute("aria-busy", "true");
    while (this.isWanted) {
      this.isWanted = false;
      try {
        await this.fetch();
        this.say("");
        this.isUnfinished = this.facts.is_coarse;
        this.onrender(this.isUnfinished);
      } catch (error) {
        const { message, needsRender } = /** @type {Error & {needsRender?: boolean}} */ (error);
        byId("viewport").classList.add("stale");
        if (this.isWanted || this.taken.signal.aborted) continue;
        this.isUnfinished = true;
        if (needsRender) this.onrender(true);
        else this.say(message);
      }
    }
    this.isBusy = false;
    byId("viewport").setAttribute("aria-busy", "false");
    this.onshown();
  }

  async fetch() {
    const { capture, view } = this.changes.shown;
    const tones = `${capture} ${view}`;
    const white = this.isHeld && this.facts && this.tones === tones ? this.facts.white : null;
    [this.asked, this.taken] = [performance.now(), new AbortController()];
    const isHeld = this.isHeld;
    const body = { set: this.changes.list(), capture, view, white, place: this.changes.place(), is_coarse: isHeld && this.isCoarse };
    const facts = await draw(body, this.canvas, "/api/picture", this.taken.signal);
    this.changes.fit({ px: facts.frame_px, mm: facts.sensor_mm });
    [this.facts, this.tones] = [facts, tones];
    this.canvas.dataset.serial = String(++this.serial);
    this.isCoarse ||= isHeld && performance.now() - this.asked > SOON;
    byId("viewport").classList.remove("stale");
    this.tell(capture, view);
    this.layOut();
  }

  /** @param {string} capture @param {string} view */
  tell(capture, view) {
    const facts = this.facts;
    const [width, height] = facts.frame_px;
    this.canvas.setAttribute("aria-label", `Frame "${capture}", ${view}, ${width} by ${height} pixels; ${facts.clipped_percent.toFixed(1)} % clipped`);
    const entries = [
      ["Exposure", `${shortNumber(facts.exposure_ms)} ms`],
      ["Gain", `${shortNumber(facts.gain)} ×`],
      ["Clipped", `${facts.clipped_percent.toFixed(facts.clipped_percent < 1 ? 2 : 1)} %`],
      ["Bright pixels", `${shortNumber(facts.bright_dn)} of ${shortNumber(facts.full_scale_dn)} DN above black`],
      ["Dark noise", `${shortNumber(facts.noise_dn)} DN`],
      ["Frame", `${width} × ${height} px`],
      ["Answered in", `${Math.round(facts.milliseconds)} ms`],
    ];
    byId("facts").replaceChildren(...entries.map(([name, value], i) =>
      make("div", { className: i < 3 ? "" : "more" }, [make("dt", { textContent: name }), make("dd", { textContent: value })])));
    byId("size").textContent = ` · ${facts.render_px.join(" × ")} px, ${facts.samples_per_pixel} samples per pixel`;
    byId("remarks").replaceChildren(...facts.remarks.map((/** @type {string} */ text) => make("li", { textContent: text })));
    if (!this.isTurned) this.drawLegend(facts.legend);
  }

  /** @param {{label: string, ends: string[], note: string, colors: number[][]} | undefined} legend */
  drawLegend(legend) {
    const place = byId("legend");
    place.hidden = !legend;
    if (!legend) return;
    const strip = make("span", { className: "strip" }, legend.colors.map((color) => {
      const step = make("span");
      step.style.backgroundColor = `rgb(${color.join(" ")})`;
      return step;
    }));
    strip.setAttribute("aria-hidden", "true");
    place.replaceChildren(make("span", { textContent: `${legend.label}: ${legend.ends[0]}` }), strip,
      make("span", { textContent: `${legend.ends[1]}; ${legend.note}` }));
  }

  /** Height of the place of the frame, px: all of it and its numbers are in sight, as far as the window allows. */
  roomHeight() {
    return Math.max(window.innerHeight - OTHER_HEIGHT, LEAST_HEIGHT);
  }

  /** Gives the picture its size on the page. */
  layOut() {
    if (!this.facts) return;
    const [width, height] = this.facts.frame_px;
    const viewport = byId("viewport");
    const ratio = window.devicePixelRatio || 1;
    const fit = Math.min(viewport.clientWidth / width, this.roomHeight() / height);
    const scale = this.zoom.value === "fit" ? fit : Number(this.zoom.value) / ratio;
    for (const layer of [this.canvas, byId("kept"), byId("drawing")]) {
      layer.style.width = `${width * scale}px`;
      layer.style.height = `${height * scale}px`;
    }
    this.canvas.classList.toggle("crisp", this.zoom.value !== "fit");
    this.drawing?.redraw();
  }

  /** @type {Drawing | undefined} */
  drawing;
  /** Whether the turned shapes are shown in place of the frame. */
  isTurned = false;
}

/** Regions by hand: a rectangle is dragged, corners of a polygon are clicked. */
export class Drawing {
  /** @param {any} picture @param {any} changes what is drawn goes to its `draw`; `now.place` is the region that is there
   * @param {any} [canvas] */
  constructor(picture, changes, canvas = byId("drawing")) {
    this.picture = picture;
    this.changes = changes;
    this.canvas = canvas;
    this.tool = "off";
    /** @type {number[] | null} */
    this.start = null;
    /** @type {number[][]} */
    this.corners = [];
    /** @type {number[] | null} */
    this.pointer = null;
    this.canvas.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => this.press(event));
    this.canvas.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => this.move(event));
    this.canvas.addEventListener("pointerup", (/** @type {PointerEvent} */ event) => this.release(event));
    this.canvas.addEventListener("dblclick", () => this.close());
    document.addEventListener("keydown", (event) => {
      if (!this.corners.length && !this.start) return;
      // A button that has the focus must not be pressed by it
      if (event.key === "Enter" || event.key === "Escape") event.preventDefault();
      if (event.key === "Enter") this.close();
      if (event.key === "Escape") this.cancel();
    });
  }

  /** @param {string} tool */
  use(tool) {
    this.cancel();
    this.tool = tool;
    this.canvas.classList.toggle("draws", tool !== "off");
  }

  cancel() {
    [this.start, this.corners, this.pointer] = [null, [], null];
    this.redraw();
  }

  /** A place on the page as pixels of the frame. @param {PointerEvent} event */
  place(event) {
    const box = this.canvas.getBoundingClientRect();
    const [width, height] = this.picture.facts.frame_px;
    const within = (/** @type {number} */ value, /** @type {number} */ most) => Math.min(Math.max(value, 0), most);
    return [within(((event.clientX - box.left) / box.width) * width, width), within(((event.clientY - box.top) / box.height) * height, height)];
  }

  /** @param {PointerEvent} event */
  press(event) {
    if (this.tool === "off" || !this.picture.facts || event.button !== 0) return;
    event.preventDefault();
    const place = this.place(event);
    if (this.tool === "rectangle") {
      this.canvas.setPointerCapture(event.pointerId);
      this.start = place;
    } else if (this.tool === "part") {
      this.changes.pick(place.map(Math.floor));
    } else {
      const first = this.corners[0];
      const near = first && Math.hypot(first[0] - place[0], first[1] - place[1]) < 0.015 * this.picture.facts.frame_px[0];
      if (near && this.corners.length > 2) return this.close();
      this.corners.push(place);
    }
    this.move(event);
  }

  /** @param {PointerEvent} event */
  move(event) {
    if (!this.start && !this.corners.length) return;
    this.pointer = this.place(event);
    this.redraw();
  }

  /** @param {PointerEvent} event */
  release(event) {
    if (!this.start) return;
    const rectangle = rectangleOf(this.start, this.place(event));
    this.cancel();
    this.changes.draw({ rectangle_px: rectangle });
  }

  /** Ends a polygon. */
  close() {
    // A double click has set its last corner twice
    const corners = this.corners.filter((corner, i) => i === 0 || Math.hypot(corner[0] - this.corners[i - 1][0], corner[1] - this.corners[i - 1][1]) > 0.5);
    this.cancel();
    if (corners.length > 2) this.changes.draw({ polygon_px: corners.map((corner) => corner.map((value) => Math.round(10 * value) / 10)) });
  }

  redraw() {
    const facts = this.picture.facts;
    if (!facts) return;
    const box = this.canvas.getBoundingClientRect();
    const ratio = window.devicePixelRatio || 1;
    const size = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) [this.canvas.width, this.canvas.height] = size;
    const pen = this.canvas.getContext("2d");
    pen.clearRect(0, 0, ...size);
    const scale = size[0] / facts.frame_px[0];
    const open = this.start && this.pointer ? cornersOf({ rectangle_px: rectangleOf(this.start, this.pointer) }) : [...this.corners, ...(this.pointer && this.corners.length ? [this.pointer] : [])];
    const isOpen = open.length > 0;
    const corners = isOpen ? open : cornersOf(this.changes.now.place);
    if (!corners.length) return;
    pen.beginPath();
    corners.forEach(([x, y], i) => (i ? pen.lineTo(x * scale, y * scale) : pen.moveTo(x * scale, y * scale)));
    if (!isOpen || this.start) pen.closePath();
    // Light within dark is seen on any picture
    for (const [color, width] of [["#000", 4], ["#fff", 1.8]]) {
      [pen.strokeStyle, pen.lineWidth] = [color, /** @type {number} */ (width) * ratio];
      pen.stroke();
    }
  }
}

/** Column, row, width and height of the pixels between two places. @param {number[]} a @param {number[]} b */
function rectangleOf(a, b) {
  const [column, row] = [0, 1].map((axis) => Math.floor(Math.min(a[axis], b[axis])));
  return [column, row, Math.max(Math.ceil(Math.max(a[0], b[0])) - column, 1), Math.max(Math.ceil(Math.max(a[1], b[1])) - row, 1)];
}

/** @param {Place} place @returns {number[][]} */
function cornersOf(place) {
  if (!place) return [];
  if (place.polygon_px) return place.polygon_px;
  if (!place.rectangle_px) return [];
  const [column, row, width, height] = place.rectangle_px;
  return [[column, row], [column + width, row], [column + width, row + height], [column, row + height]];
}
