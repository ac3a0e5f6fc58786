// The shapes from any side: drag or arrow keys turn them, the wheel or plus and minus bring them nearer, a click names a part.
// @ts-check
import { draw } from "./picture.js";

const byId = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
/** Views that can be turned. */
export const TURNED = ["clay", "part", "depth"];
/** Widest picture and narrowest, px; how long one may take while it is turned, ms; degrees of an arrow key and of a pixel. */
const WIDTHS = [160, 1280];
const SOON = 50;
const ARROW = 6;
const PER_PX = 0.4;
/** Rest after which a sharp picture is asked for, ms. */
const REST = 200;
const FRONT = { yaw_deg: 0, pitch_deg: 0, zoom: 1 };

export class Orbit {
  /** @param {import("./changes.js").Changes} changes @param {import("./picture.js").Picture} picture @param {(text: string) => void} say */
  constructor(changes, picture, say) {
    this.changes = changes;
    this.picture = picture;
    this.say = say;
    /** @type {HTMLCanvasElement} */
    this.canvas = byId("orbit");
    this.camera = { ...FRONT };
    this.width = 640;
    this.isOn = false;
    this.isBusy = false;
    /** What is wanted next, with the place that is asked about. @type {{isSharp: boolean, at?: number[]} | null} */
    this.next = null;
    /** @type {number[] | null} */
    this.held = null;
    this.moved = 0;
    this.serial = 0;
    this.failed = false;
    /** Until when a sharp picture waits; 0 where none does. */
    this.timer = 0;
    this.canvas.addEventListener("pointerdown", (event) => this.press(event));
    this.canvas.addEventListener("pointermove", (event) => this.move(event));
    this.canvas.addEventListener("pointerup", (event) => this.release(event));
    this.canvas.addEventListener("pointercancel", () => (this.held = null));
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.turn(0, 0, Math.exp(-0.0015 * event.deltaY));
    }, { passive: false });
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    byId("front").addEventListener("click", () => this.turn(-this.camera.yaw_deg, -this.camera.pitch_deg, 1 / this.camera.zoom));
  }

  /** Shows the shapes in place of the frame, or the frame again. @param {boolean} isOn */
  use(isOn) {
    this.isOn = this.picture.isTurned = isOn;
    if (!isOn) this.picture.drawLegend(this.picture.facts?.legend);
    byId("layers").hidden = isOn;
    byId("orbited").hidden = !isOn;
    if (isOn) this.refresh();
  }

  /** Draws what is shown now. */
  refresh() {
    this.layOut();
    this.want({ isSharp: true });
  }

  layOut() {
    const room = byId("viewport").clientWidth;
    const [width, height] = this.picture.facts?.render_px ?? [4, 3];
    this.canvas.style.width = `${Math.min(room, (this.picture.roomHeight() * width) / height)}px`;
  }

  /** @param {number} yaw @param {number} pitch @param {number} nearer */
  turn(yaw, pitch, nearer = 1) {
    const { yaw_deg, pitch_deg, zoom } = this.camera;
    this.camera = {
      yaw_deg: ((yaw_deg + yaw + 540) % 360) - 180,
      pitch_deg: Math.min(Math.max(pitch_deg + pitch, -90), 90),
      zoom: Math.min(Math.max(zoom * nearer, 0.2), 8),
    };
    this.want({ isSharp: false });
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => {
      this.timer = 0;
      this.want({ isSharp: true });
    }, REST);
  }

  /** @param {{isSharp: boolean, at?: number[]}} wanted */
  async want(wanted) {
    this.next = { ...wanted, at: wanted.at ?? this.next?.at };
    if (this.isBusy) return;
    this.isBusy = true;
    byId("orbited").setAttribute("aria-busy", "true");
    while (this.isOn && this.next) {
      const now = this.next;
      this.next = null;
      await this.show(now);
    }
    [this.isBusy, this.next] = [false, null];
    byId("orbited").setAttribute("aria-busy", String(this.timer !== 0));
  }

  /** @param {{isSharp: boolean, at?: number[]}} now */
  async show({ isSharp, at }) {
    const sharp = this.canvas.clientWidth * (window.devicePixelRatio || 1);
    const width_px = Math.round(Math.min(Math.max(isSharp ? sharp : Math.min(this.width, sharp), WIDTHS[0]), WIDTHS[1]));
    const { view } = this.changes.shown;
    const begun = performance.now();
    try {
      const facts = await draw({ set: this.changes.list(), view, ...this.camera, width_px, at }, this.canvas, "/api/orbit");
      // As fine as there is time for while it is turned
      const took = performance.now() - begun;
      if (!isSharp) this.width = Math.round(Math.min(Math.max(this.width * Math.min(Math.max(SOON / took, 0.7), 1.15), WIDTHS[0]), 640));
      this.picture.drawLegend(facts.legend);
      if (at) byId("picked").textContent = facts.picked ? `${facts.picked.part.replaceAll("_", " ")} · ${facts.picked.material} · ${facts.picked.distance_mm.toFixed(1)} mm away` : "Nothing is there.";
      this.canvas.dataset.serial = String(++this.serial);
      // Other messages stay
      if (this.failed) this.say("");
      this.failed = false;
    } catch (error) {
      this.failed = true;
      this.say(/** @type {Error} */ (error).message);
    }
  }

  /** @param {PointerEvent} event */
  press(event) {
    if (event.button !== 0) return;
    this.canvas.setPointerCapture(event.pointerId);
    [this.held, this.moved] = [[event.clientX, event.clientY], 0];
  }

  /** @param {PointerEvent} event */
  move(event) {
    if (!this.held) return;
    const [x, y] = [event.clientX - this.held[0], event.clientY - this.held[1]];
    this.moved += Math.hypot(x, y);
    this.held = [event.clientX, event.clientY];
    if (this.moved > 3) this.turn(-PER_PX * x, PER_PX * y);
  }

  /** @param {PointerEvent} event */
  release(event) {
    if (this.held && this.moved <= 3) {
      const box = this.canvas.getBoundingClientRect();
      this.want({ isSharp: true, at: [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height] });
    }
    this.held = null;
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    /** @type {Record<string, () => void>} */
    const acts = {
      ArrowLeft: () => this.turn(-ARROW, 0),
      ArrowRight: () => this.turn(ARROW, 0),
      ArrowUp: () => this.turn(0, ARROW),
      ArrowDown: () => this.turn(0, -ARROW),
      "+": () => this.turn(0, 0, 1.15),
      "-": () => this.turn(0, 0, 1 / 1.15),
      Home: () => byId("front").click(),
      Enter: () => this.want({ isSharp: true, at: [0.5, 0.5] }),
    };
    if (!acts[event.key]) return;
    event.preventDefault();
    acts[event.key]();
  }
}
