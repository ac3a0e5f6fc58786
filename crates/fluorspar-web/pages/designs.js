// The designs of a search as dots: pick one, see what a report says of it, and of another beside it.
// @ts-check
import { niceStep, shortNumber, svg } from "./chart.js";
import { make } from "./controls.js";
import { Tabs } from "./findings.js";
import { ask } from "./picture.js";

/** @typedef {{number: number} | {compared: number}} Key */
/** @typedef {{key: Key, name: string, loss: number, time_ms: number, price: number, exposures: number, is_best: boolean, is_front: boolean}} Design */

const byId = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const MARGIN = { left: 58, right: 14, top: 24, bottom: 42 };
/** How far from a dot the pointer may be, px. */
const NEAR = 24;
/** Losses beyond this multiple of the least are not drawn. */
const WORST = 1e4;
/** Less is drawn as this: the axis is logarithmic. */
const LEAST = 1e-12;
/** Fewer dots are larger. */
const MANY = 60;
/** @type {Record<string, [string, (design: Design, place: number) => number]>} */
const AXES = {
  time: ["time of all exposures, ms", (design) => design.time_ms],
  price: ["price", (design) => design.price],
  exposures: ["exposures", (design) => design.exposures],
  place: ["place by loss", (_, place) => place + 1],
};

/** Whether values differ by more than the rounding of sums. @param {number[]} values */
const varies = (values) => Math.max(...values) - Math.min(...values) > 1e-9 * Math.max(...values.map(Math.abs));
/** @param {Key | null} key */
const textOf = (key) => (!key ? "" : "number" in key ? String(key.number) : `c${key.compared}`);
/** @param {string | null} text @returns {Key | null} */
function keyOf(text) {
  const found = /^(c?)(\d+)$/.exec(text ?? "");
  return found && (found[1] ? { compared: Number(found[2]) } : { number: Number(found[2]) });
}

export class Designs {
  /** @param {any} subject @param {(text: string) => void} say */
  constructor(subject, say) {
    this.say = say;
    /** By loss. @type {Design[]} */
    this.all = subject.designs;
    /** @type {Key[]} */
    this.compared = subject.compared.map((/** @type {string} */ _, /** @type {number} */ place) => ({ compared: place }));
    this.names = new Map([...subject.compared.map((/** @type {string} */ name, /** @type {number} */ place) => [`c${place}`, name]), ...this.all.map(({ key, name }) => [textOf(key), name])]);
    /** @type {Key | null} */
    this.picked = subject.recommended ?? this.all[0]?.key ?? this.compared[0] ?? null;
    /** @type {Key | null} */
    this.beside = null;
    this.taken = new AbortController();
    this.tabs = new Tabs(byId("design-tabs"), byId("design-panel"), "design-tab");
    this.recommended = textOf(subject.recommended);
    byId("designs-text").textContent = [`Ranked by ${subject.criterion}; less is better.`, `Chosen: ${subject.search}.`, subject.drawn, subject.left_out && `${subject.left_out}.`].filter(Boolean).join(" ");
    this.varying = Object.keys(AXES).filter((name) => name === "place" || varies(this.all.map(AXES[name][1])));
    byId("design-axis").replaceChildren(...this.varying.map((value) => make("option", { value, textContent: AXES[value][0] })));
    byId("design-key").hidden = !this.all.some(({ key }) => "compared" in key);
    byId("design-axis").addEventListener("change", () => this.draw());
    byId("design-words").addEventListener("input", () => this.draw());
    byId("design-beside").addEventListener("change", () => {
      this.beside = keyOf(byId("design-beside").value);
      this.look();
    });
    const plot = byId("design-plot");
    plot.addEventListener("click", (/** @type {MouseEvent} */ event) => this.pick(this.near(event)));
    plot.addEventListener("pointermove", (/** @type {MouseEvent} */ event) => this.hover(this.near(event)));
    plot.addEventListener("pointerleave", () => this.hover(undefined));
    plot.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => this.step(event));
    new ResizeObserver(() => this.draw()).observe(byId("design-room"));
    window.addEventListener("hashchange", () => this.read());
    this.read();
  }

  /** Takes what the address holds, where that is another design. */
  read() {
    const told = new URLSearchParams(location.hash.slice(1));
    const known = (/** @type {string | null} */ text) => (this.names.has(text ?? "") ? keyOf(text) : null);
    const before = location.hash.slice(1);
    if (before === this.fragment() && byId("design-panel").firstChild) return;
    this.picked = known(told.get("design")) ?? this.picked;
    this.beside = known(told.get("beside"));
    this.look();
  }

  fragment() {
    const text = new URLSearchParams({ design: textOf(this.picked) });
    if (this.beside) text.set("beside", textOf(this.beside));
    return text.toString();
  }

  /** @param {Design | undefined} design */
  pick(design) {
    if (!design) return;
    this.picked = design.key;
    this.look();
  }

  /** Asks what is to be said of the picked design, and of the other beside it. */
  async look() {
    history.replaceState(null, "", `#${this.fragment()}`);
    byId("design-name").textContent = this.picked ? this.names.get(textOf(this.picked)) : "No design sees what is asked for.";
    this.list();
    this.draw();
    if (!this.picked) return;
    this.taken.abort();
    this.taken = new AbortController();
    byId("design-body").classList.add("stale");
    const { signal } = this.taken;
    try {
      const designs = [this.picked, ...(this.beside ? [this.beside] : [])];
      const told = await (await ask("/api/design", { designs }, signal)).json();
      this.say("");
      this.tabs.tell(told.sections);
      byId("design-body").classList.remove("stale");
    } catch (error) {
      if (!signal.aborted) this.say(/** @type {Error} */ (error).message);
    }
  }

  /** The best, the front and those to compare with, as a table of buttons. */
  list() {
    const picked = textOf(this.picked);
    const shown = this.all.filter(({ key, is_best, is_front }) => is_best || is_front || "compared" in key || textOf(key) === picked);
    const columns = this.varying.filter((name) => name !== "place").map((name) => AXES[name]);
    const row = (/** @type {Design} */ design) => {
      const open = make("button", { type: "button", className: "plain", textContent: design.name });
      open.setAttribute("aria-pressed", String(textOf(design.key) === picked));
      open.addEventListener("click", () => this.pick(design));
      const best = design === this.all.find(({ is_best }) => is_best) ? "recommended" : "recommended within tolerances";
      const kind = [textOf(design.key) === this.recommended ? best : "", "compared" in design.key ? "compared" : design.is_front ? "front" : ""].filter(Boolean).join(", ");
      const cells = [...[design.loss, ...columns.map(([, value]) => value(design, 0))].map(shortNumber), kind];
      return make("tr", {}, [make("th", { scope: "row" }, [open]), ...cells.map((textContent) => make("td", { textContent }))]);
    };
    const heads = ["design", "loss", ...columns.map(([label]) => label.replace(" of all exposures", "")), ""];
    byId("design-heads").replaceChildren(...heads.map((textContent) => make("th", { scope: "col", textContent })));
    byId("design-list").replaceChildren(...shown.map(row));
    const others = [["", "none"], ...this.compared.map((key) => [textOf(key), this.names.get(textOf(key))]), ...shown.filter(({ key }) => !("compared" in key)).map(({ key, name }) => [textOf(key), name])];
    byId("design-beside").replaceChildren(...others.map(([value, textContent]) => make("option", { value, textContent })));
    byId("design-beside").value = textOf(this.beside);
  }

  /** Whether a design is among those that the typed words leave. @param {Design} design */
  isMeant({ name }) {
    const words = byId("design-words").value.toLowerCase().split(/\s+/).filter(Boolean);
    return words.every((/** @type {string} */ word) => name.toLowerCase().includes(word));
  }

  draw() {
    const plot = byId("design-plot");
    const width = Math.max(Math.min(byId("design-room").clientWidth, 1100), 280);
    const height = Math.round(Math.min(Math.max(0.55 * width, 240), 460));
    const [label, value] = AXES[byId("design-axis").value];
    const seen = this.all.map((design, place) => ({ design, x: value(design, place) }));
    if (!seen.length) return plot.replaceChildren();
    const least = Math.max(this.all[0].loss, LEAST);
    const [low, high] = [Math.log10(least * 0.85), Math.log10(Math.min(this.all.at(-1)?.loss ?? least, least * WORST) * 1.15)];
    const [first, last] = [Math.min, Math.max].map((end) => end(...seen.map(({ x }) => x)));
    const step = niceStep(last - first > 1e-9 * last ? last - first : 1);
    const left = Math.max(Math.floor((first - 0.2 * step) / step) * step, 0);
    const right = last + 0.2 * step;
    const toX = (/** @type {number} */ at) => MARGIN.left + ((at - left) / (right - left)) * (width - MARGIN.left - MARGIN.right);
    const toY = (/** @type {number} */ loss) => MARGIN.top + ((high - Math.log10(Math.max(loss, LEAST))) / (high - low)) * (height - MARGIN.top - MARGIN.bottom);
    this.dots = seen.filter(({ design }) => design.loss <= 10 ** high).map(({ design, x }) => ({ design, x: toX(x), y: toY(design.loss) }));
    const parts = [];
    for (let tick = 0; tick <= (right - left) / step; tick++) {
      const at = left + tick * step;
      parts.push(svg("line", { x1: toX(at), x2: toX(at), y1: MARGIN.top, y2: height - MARGIN.bottom, class: "grid" }),
        svg("text", { x: toX(at), y: height - MARGIN.bottom + 16, class: "tick", "text-anchor": "middle" }, shortNumber(at)));
    }
    for (let power = Math.floor(low); power <= high; power++) {
      for (const factor of high - low > 1.6 ? [1] : high - low > 0.7 ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 5, 7]) {
        const loss = factor * 10 ** power;
        if (Math.log10(loss) < low || Math.log10(loss) > high) continue;
        parts.push(svg("line", { x1: MARGIN.left, x2: width - MARGIN.right, y1: toY(loss), y2: toY(loss), class: "grid" }),
          svg("text", { x: MARGIN.left - 6, y: toY(loss) + 4, class: "tick", "text-anchor": "end" }, shortNumber(loss)));
      }
    }
    parts.push(svg("text", { x: width - MARGIN.right, y: height - 6, class: "tick", "text-anchor": "end" }, label),
      svg("text", { x: MARGIN.left - 6, y: 12, class: "tick", "text-anchor": "end" }, "loss"));
    const marks = (/** @type {string} */ kind, /** @type {(design: Design) => boolean} */ is) => {
      const places = this.dots.filter(({ design }) => is(design)).map(({ x, y }) => `M${x.toFixed(1)} ${y.toFixed(1)}h0`);
      parts.push(svg("path", { d: places.join(""), class: `dots ${kind}${this.dots.length < MANY ? " large" : ""}` }));
    };
    const isPlain = (/** @type {Design} */ design) => !design.is_front && !("compared" in design.key);
    marks("faint", (design) => isPlain(design) && !this.isMeant(design));
    marks("plain", (design) => isPlain(design) && this.isMeant(design));
    marks("front", (design) => design.is_front && this.isMeant(design));
    marks("beside", (design) => "compared" in design.key);
    for (const [key, kind] of [[this.beside, "ring other"], [this.picked, "ring"]]) {
      const dot = this.dots.find(({ design }) => key && textOf(design.key) === textOf(/** @type {Key} */ (key)));
      if (dot) parts.push(svg("circle", { cx: dot.x, cy: dot.y, r: 9, class: String(kind) }));
    }
    plot.setAttribute("viewBox", `0 0 ${width} ${height}`);
    [plot.style.width, plot.style.height] = [`${width}px`, `${height}px`];
    plot.replaceChildren(...parts);
    const meant = this.all.filter((design) => this.isMeant(design)).length;
    byId("design-count").textContent = `${meant} of ${this.all.length} designs`;
  }

  /** The dot at the pointer. @param {MouseEvent} event */
  near(event) {
    const box = byId("design-plot").getBoundingClientRect();
    const scale = byId("design-plot").viewBox.baseVal.width / box.width;
    const [x, y] = [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale];
    let [best, least] = [undefined, NEAR];
    for (const dot of this.dots ?? []) {
      const away = Math.hypot(dot.x - x, dot.y - y);
      if (away < least && this.isMeant(dot.design)) [best, least] = [dot.design, away];
    }
    return best;
  }

  /** @param {Design | undefined} design */
  hover(design) {
    byId("design-hover").textContent = design ? `${design.name}: loss ${shortNumber(design.loss)}, ${shortNumber(design.time_ms)} ms` : "Click a dot, or go from one to the next by arrow keys.";
    byId("design-plot").style.cursor = design ? "pointer" : "default";
  }

  /** Arrow keys go from design to design, by loss. @param {KeyboardEvent} event */
  step(event) {
    const meant = this.all.filter((design) => this.isMeant(design));
    const now = meant.findIndex(({ key }) => textOf(key) === textOf(this.picked));
    const to = { ArrowRight: now + 1, ArrowUp: now + 1, ArrowLeft: now - 1, ArrowDown: now - 1, Home: 0, End: meant.length - 1 }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    this.pick(meant[Math.min(Math.max(to, 0), meant.length - 1)]);
    this.hover(meant[to]);
  }
}
