// What a report says of what is shown, section by section: asked while its place is open, first what needs no spectra.
// @ts-check
import { make } from "./controls.js";
import { ask } from "./picture.js";

const byId = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
/** Rest after a change, ms: a report takes longer than an estimate. */
const REST = 700;

/** Sections of a report as tabs over a panel. */
export class Tabs {
  /** @param {HTMLElement} list @param {HTMLElement} panel @param {string} name what the ids of tabs begin with */
  constructor(list, panel, name) {
    [this.list, this.panel, this.name] = [list, panel, name];
    this.chosen = "";
    list.addEventListener("keydown", (event) => this.step(event));
  }

  /** @param {{title: string, note: string, html: string}[]} sections */
  tell(sections) {
    if (!sections.some(({ title }) => title === this.chosen)) this.chosen = sections[0].title;
    const tabs = sections.map((section, number) => {
      const tab = make("button", { type: "button", id: `${this.name}-${number}`, textContent: section.title });
      tab.setAttribute("role", "tab");
      tab.setAttribute("aria-controls", this.panel.id);
      tab.addEventListener("click", () => this.choose(section, tab));
      return tab;
    });
    this.list.replaceChildren(...tabs);
    const chosen = sections.findIndex(({ title }) => title === this.chosen);
    this.choose(sections[chosen], tabs[chosen]);
  }

  /** @param {{title: string, note: string, html: string}} section @param {HTMLElement} tab */
  choose(section, tab) {
    this.chosen = section.title;
    for (const other of this.list.children) {
      other.setAttribute("aria-selected", String(other === tab));
      other.tabIndex = other === tab ? 0 : -1;
    }
    const { panel } = this;
    panel.setAttribute("aria-labelledby", tab.id);
    // The server escapes all text in it, and the content policy forbids scripts
    panel.innerHTML = section.html;
    panel.prepend(make("p", { className: "note", textContent: section.note }));
    for (const wide of panel.querySelectorAll(".scroll")) wide.tabIndex = 0;
  }

  /** Arrow keys go from tab to tab. @param {KeyboardEvent} event */
  step(event) {
    const tabs = [...this.list.children];
    const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!by) return;
    event.preventDefault();
    const next = tabs[(tabs.indexOf(document.activeElement) + by + tabs.length) % tabs.length];
    next.focus();
    next.click();
  }
}

export class Findings {
  /** @param {import("./changes.js").Changes} changes @param {import("./picture.js").Picture} picture */
  constructor(changes, picture) {
    this.changes = changes;
    this.picture = picture;
    this.serial = 0;
    this.taken = new AbortController();
    /** What is told, as it was asked for. */
    this.told = "";
    this.tabs = new Tabs(byId("tabs"), byId("findings-panel"), "tab");
    /** @type {number | undefined} */
    this.timer = undefined;
    byId("findings-fold").addEventListener("toggle", () => this.refresh());
  }

  body() {
    return { set: this.changes.list(), place: this.changes.place() };
  }

  refresh() {
    if (JSON.stringify(this.body()) === this.told) return;
    this.taken.abort();
    byId("findings-body").classList.add("stale");
    clearTimeout(this.timer);
    if (byId("findings-fold").open) this.timer = window.setTimeout(() => this.fetch(), REST);
  }

  async fetch() {
    if (this.picture.isHeld || this.picture.isBusy || this.picture.isUnfinished || !this.picture.facts) return this.refresh();
    const serial = ++this.serial;
    const body = this.body();
    this.taken = new AbortController();
    try {
      for (const with_spectra of [false, true]) {
        byId("findings-state").textContent = with_spectra ? "Splitting the light by origin …" : "Reading the frames …";
        const told = await (await ask("/api/findings", { ...body, with_spectra }, this.taken.signal)).json();
        if (serial !== this.serial) return;
        byId("findings-body").classList.remove("stale");
        this.tabs.tell(told.sections);
      }
      this.told = JSON.stringify(body);
      byId("findings-state").textContent = "";
    } catch (error) {
      if (serial === this.serial && !this.taken.signal.aborted) byId("findings-state").textContent = /** @type {Error} */ (error).message;
    }
  }
}
