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
    /** @type {number | undefined} */
    this.timer = undefined;
    byId("corners").addEventListener("submit", (/** @type {Event} */ event) => {
      event.preventDefault();
      const field = (/** @type {string} */ name) => Math.max(Math.round(Number(byId("corners").elements[name].value)), 0);
      changes.draw({ rectangle_px: [field("column"), field("row"), Math.max(field("width"), 1), Math.max(field("height"), 1)] });
    });
    byId("clear").addEventListener("click", () => changes.draw(null));
  }

  /** Marks what is told as of an earlier state, and asks anew after a rest. */
  refresh() {
    byId("region").classList.add("stale");
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.fetch(), REST);
  }

  async fetch() {
    if (this.picture.isHeld || this.picture.isBusy || !this.picture.facts) return this.refresh();
    const serial = ++this.serial;
    const { place } = this.changes.now;
    this.tellPlace();
    try {
      const body = { set: this.changes.list(), capture: this.changes.shown.capture, frame_px: this.picture.facts.frame_px, place };
      const told = await (await ask("/api/region", body)).json();
      if (serial === this.serial) this.tell(told);
    } catch (error) {
      if (serial === this.serial) this.tell({ lines: [], warnings: [], no_estimate: /** @type {Error} */ (error).message });
    }
  }

  tellPlace() {
    const { place } = this.changes.now;
    const { analyzed, parts } = this.subject;
    const own = parts?.length ? parts.join(", ").replaceAll("_", " ") : "the whole analysis";
    byId("place").textContent = place
      ? "polygon_px" in place ? `A polygon of ${place.polygon_px.length} corners` : `A rectangle of ${place.rectangle_px[2]} × ${place.rectangle_px[3]} pixels`
      : analyzed ? `Of the analysis: ${own}` : "Draw a region on the frame.";
    byId("clear").hidden = !place || !analyzed;
    const fields = byId("corners").elements;
    const numbers = place && "rectangle_px" in place ? place.rectangle_px : ["", "", "", ""];
    ["column", "row", "width", "height"].forEach((name, i) => (fields[name].value = String(numbers[i])));
  }

  /** @param {any} told */
  tell(told) {
    byId("region").classList.toggle("stale", false);
    byId("verdict").textContent = told.no_estimate ? `No estimate: ${told.no_estimate}` : `${told.lines[0]} (frame "${told.frame}")`;
    byId("verdict").classList.toggle("none", Boolean(told.no_estimate));
    const lines = [...told.lines.slice(1), ...told.warnings.map((/** @type {string} */ text) => `Note: ${text}`)];
    byId("findings").replaceChildren(...lines.map((line) => make("li", { textContent: line.trim() })));
    byId("details").hidden = lines.length === 0;
    const place = byId("spectra");
    if (!told.spectra) {
      place.replaceChildren(make("p", { className: "note", textContent: told.no_spectra ?? "" }));
      return;
    }
    const wasOpen = place.querySelector("details")?.open;
    const hasReflected = byId("with-reflected")?.checked ?? false;
    const box = make("input", { type: "checkbox", id: "with-reflected", checked: hasReflected });
    const label = make("label", { className: "auto" }, [box, "with reflected light"]);
    box.addEventListener("change", () => place.replaceChildren(label, chart(told.spectra, box.checked)));
    place.replaceChildren(label, chart(told.spectra, hasReflected));
    if (wasOpen) place.querySelector("details").open = true;
  }
}
