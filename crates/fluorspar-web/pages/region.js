// What the pixels of a region say: the verdict with its interval, and the light that leaves them.
// @ts-check
import { chart } from "./chart.js";
import { make } from "./controls.js";
import { ask } from "./picture.js";

/** @typedef {import("./changes.js").Changes} Changes */

const byId = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
/** Rest after a change before the region is asked, ms: an estimate takes longer than a picture. */
const REST = 250;

export class Region {
  /** @param {Changes} changes @param {import("./picture.js").Picture} picture @param {any} subject */
  constructor(changes, picture, subject) {
    this.changes = changes;
    this.picture = picture;
    this.subject = subject;
    this.serial = 0;
    this.taken = new AbortController();
    /** @type {number | undefined} */
    this.timer = undefined;
    byId("corners").addEventListener("submit", (/** @type {Event} */ event) => {
      event.preventDefault();
      const field = (/** @type {string} */ name) => Math.max(Math.round(Number(byId("corners").elements[name].value)), 0);
      changes.draw({ rectangle_px: [field("column"), field("row"), Math.max(field("width"), 1), Math.max(field("height"), 1)] });
    });
    let width = 0;
    new ResizeObserver(([entry]) => {
      if (Math.abs(entry.contentRect.width - width) > 1) this.redraw();
      width = entry.contentRect.width;
    }).observe(byId("spectra"));
    byId("clear").addEventListener("click", () => changes.draw(null));
    changes.pick = async ([column, row]) => {
      const frame_px = this.picture.facts.frame_px;
      const at_px = [Math.min(column, frame_px[0] - 1), Math.min(row, frame_px[1] - 1)];
      try {
        const { part } = await (await ask("/api/part", { set: changes.list(), frame_px, at_px })).json();
        if (part) changes.draw({ part });
        else this.picture.say("No part is there.");
      } catch (error) {
        this.picture.say(/** @type {Error} */ (error).message);
      }
    };
    byId("part").addEventListener("change", () => changes.draw({ ...changes.now.place, part: byId("part").value }));
  }

  /** Marks what is told as of an earlier state, and asks anew after a rest. */
  refresh() {
    this.taken.abort();
    byId("region").classList.add("stale");
    byId("answer").classList.add("stale");
    // The first estimate of a scene solves its tissues
    if (!byId("verdict").textContent) byId("verdict").textContent = "Estimating …";
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.fetch(), REST);
  }

  async fetch() {
    if (this.picture.isHeld || this.picture.isBusy || this.picture.isUnfinished || !this.picture.facts) return this.refresh();
    const serial = ++this.serial;
    this.tellPlace();
    try {
      const body = { set: this.changes.list(), capture: this.changes.shown.capture, frame_px: this.picture.facts.frame_px, place: this.changes.place() };
      this.taken = new AbortController();
      const told = await (await ask("/api/region", body, this.taken.signal)).json();
      if (serial === this.serial) this.tell(told);
    } catch (error) {
      if (serial === this.serial && !this.taken.signal.aborted) this.tell({ lines: [], warnings: [], no_estimate: /** @type {Error} */ (error).message });
    }
  }

  tellPlace() {
    const { place } = this.changes.now;
    const { analyzed, parts } = this.subject;
    const own = parts?.length ? parts.join(", ").replaceAll("_", " ") : "the whole analysis";
    const { polygon_px: corners, rectangle_px: rectangle } = place ?? {};
    byId("place").textContent = corners ? `A polygon of ${corners.length} corners`
      : place?.part && !rectangle ? `The part ${place.part.replaceAll("_", " ")}.`
      : rectangle ? `A rectangle of ${rectangle[2]} × ${rectangle[3]} pixels`
      : analyzed ? `Of the analysis: ${own}. Draw another one on the frame.` : "Draw a region on the frame.";
    byId("clear").hidden = !place || !analyzed;
    const fields = byId("corners").elements;
    const numbers = rectangle ?? ["", "", "", ""];
    ["column", "row", "width", "height"].forEach((name, i) => (fields[name].value = String(numbers[i])));
  }

  /** @param {any} told */
  tell(told) {
    byId("region").classList.remove("stale");
    byId("answer").classList.remove("stale");
    this.tellPart(told);
    // A number stays with its percent sign
    const [verdict, ...rest] = told.lines.map((/** @type {string} */ line) => line.trim().replaceAll(" %", "\u00a0%"));
    // Without a share there is no verdict, and what is left are findings
    const isVerdict = told.lines.length > 0 && !told.lines[0].startsWith(" ");
    const none = told.no_estimate ?? (isVerdict ? null : "too little light, or nothing to tell it by");
    const truth = rest.find((/** @type {string} */ line) => line.startsWith("True "));
    byId("verdict").textContent = none === null ? verdict : `No estimate: ${none}`;
    byId("verdict").classList.toggle("none", none !== null);
    byId("answer").textContent = none === null ? verdict : "";
    byId("truth").textContent = [truth && `The simulation knows: ${truth}.`, told.frame && `From frame "${told.frame}".`].filter(Boolean).join(" ");
    const lines = [...rest, ...told.warnings.map((/** @type {string} */ text) => `Note: ${text}`)];
    byId("lines").replaceChildren(...lines.map((line) => make("li", { textContent: line })));
    byId("details").hidden = lines.length === 0;
    this.tellSpectra(told);
  }

  /** @param {any} told */
  tellPart(told) {
    byId("part-choice").hidden = !this.changes.now.place || !told.parts?.length;
    if (byId("part-choice").hidden) return;
    this.changes.settle(told.part);
    history.replaceState(null, "", `#${this.changes.fragment()}`);
    const entries = told.parts.map((/** @type {[string, number]} */ [name, pixels]) => [name, `${name.replaceAll("_", " ")} (${pixels} px of the render)`]);
    byId("part").replaceChildren(make("option", { value: "", textContent: "all pixels" }),
      ...entries.map((/** @type {string[]} */ [value, textContent]) => make("option", { value, textContent })));
    byId("part").value = told.part;
  }

  /** @param {any} told */
  tellSpectra(told) {
    const place = byId("spectra");
    if (!told.spectra) {
      place.replaceChildren(make("p", { className: "note", textContent: told.no_spectra ?? "" }));
      return;
    }
    const wasOpen = place.querySelector("details")?.open;
    const box = make("input", { type: "checkbox", id: "with-reflected", checked: byId("with-reflected")?.checked ?? false });
    const label = make("label", { className: "auto" }, [box, "with reflected light"]);
    const draw = () => place.replaceChildren(label, chart(told.spectra, box.checked, place.clientWidth));
    box.addEventListener("change", draw);
    this.redraw = draw;
    draw();
    if (wasOpen) place.querySelector("details").open = true;
  }

  redraw = () => {};
}
