// A picture that is kept, to wipe over the one that is shown.
// @ts-check
import { draw } from "./picture.js";

const byId = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));

export class Compare {
  /** @param {import("./changes.js").Changes} changes @param {import("./picture.js").Picture} picture @param {(text: string) => void} say */
  constructor(changes, picture, say) {
    this.changes = changes;
    this.picture = picture;
    this.say = say;
    /** What the kept picture was asked with. */
    this.asked = "";
    byId("keep").addEventListener("click", () => this.keep(changes.list()));
    byId("forget").addEventListener("click", () => this.keep(null));
    byId("swap").addEventListener("click", () => this.swap());
    byId("wipe").addEventListener("input", () => this.wipe());
    this.wipe();
  }

  /** @param {string[] | null} list */
  keep(list) {
    this.changes.kept = list;
    this.changes.onchange("place");
    this.refresh();
  }

  swap() {
    const list = this.changes.list();
    this.changes.remember();
    this.changes.now.set = Object.fromEntries((this.changes.kept ?? []).map((text) => [text.slice(0, text.indexOf("=")), text.slice(text.indexOf("=") + 1)]));
    this.changes.kept = list;
    this.changes.onchange("set");
  }

  /** Brings the kept picture to the capture, view and tones of the shown one. */
  async refresh() {
    const { kept, shown } = this.changes;
    byId("compare").hidden = byId("kept").hidden = !kept;
    byId("keep").hidden = Boolean(kept);
    if (!kept || !this.picture.facts || this.picture.isHeld) return;
    byId("kept-list").textContent = kept.length ? kept.join(", ") : "the experiment as it was rendered";
    const { white } = this.picture.facts;
    // Levels of one sensor are shown with one white, so that brighter is brighter
    const body = { set: kept, ...shown, white: shown.view === "developed" || shown.view === "clip" || shown.view === "raw" ? white : null, place: this.changes.place() };
    const asked = JSON.stringify(body);
    if (asked === this.asked) return;
    this.asked = asked;
    try {
      const facts = await draw(body, byId("kept"));
      if (facts.full_scale_dn !== this.picture.facts.full_scale_dn) await draw({ ...body, white: null }, byId("kept"));
    } catch (error) {
      this.asked = "";
      this.say(/** @type {Error} */ (error).message);
    }
  }

  wipe() {
    const percent = Number(byId("wipe").value);
    byId("kept").style.clipPath = `inset(0 ${100 - percent}% 0 0)`;
    byId("wipe").setAttribute("aria-valuetext", `${percent} % of the width shows A`);
  }
}
