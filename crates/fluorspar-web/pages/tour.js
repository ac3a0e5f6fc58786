// A first-time tour of five steps, beside what it tells of; the page stays usable under it.
// @ts-check

const byId = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
/** What is pointed at, and what is said of it. */
const STEPS = [
  ["stage", "The frame", "This is what the camera records. Choose a capture, and how it is shown: developed, raw, where it clips, or the mouth as clay that “Turn in 3-D” turns."],
  ["groups", "Turn something", "Move a drive, an exposure, a concentration or another filter, and the frame follows at once. A person, a pose or a lesion is rendered anew, coarse first. The path below each is that of the experiment file."],
  ["region", "Ask about a place", "Drag a rectangle on the frame, or click a part with the tool “Part”. Here stands what its pixels say, with an interval, beside the truth."],
  ["findings-section", "See why", "Open this for all that a report tells: errors and their sources, leak through the filter, safety of the light."],
  ["changes", "Keep it", "Every change can be undone, and the address of this page holds all of them. Save the TOML to run it again, or make a report."],
];
/** Cookies belong to this machine whatever the port, which is another one each time. */
const SEEN = "fluorspar_tour=seen";

export class Tour {
  constructor() {
    this.step = 0;
    this.dialog = byId("tour");
    byId("tour-begin").addEventListener("click", () => this.show(0));
    byId("tour-next").addEventListener("click", () => (this.step + 1 < STEPS.length ? this.show(this.step + 1) : this.end()));
    byId("tour-back").addEventListener("click", () => this.show(this.step - 1));
    byId("tour-end").addEventListener("click", () => this.end());
    this.dialog.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
      if (event.key === "Escape") this.end();
    });
  }

  /** Begins by itself where it was never seen. */
  begin() {
    if (!document.cookie.split("; ").includes(SEEN)) this.show(0);
  }

  /** @param {number} step */
  show(step) {
    this.step = step;
    const [id, title, text] = STEPS[step];
    this.mark(id);
    byId("tour-count").textContent = `${step + 1} of ${STEPS.length}`;
    byId("tour-title").textContent = title;
    byId("tour-text").textContent = text;
    byId("tour-back").hidden = step === 0;
    byId("tour-next").textContent = step + 1 < STEPS.length ? "Next" : "Done";
    if (!this.dialog.open) this.dialog.show();
    byId("tour-next").focus({ preventScroll: true });
  }

  /** @param {string} [id] */
  mark(id) {
    for (const marked of document.querySelectorAll(".toured")) marked.classList.remove("toured");
    if (!id) return;
    byId(id).classList.add("toured");
    byId(id).scrollIntoView({ block: "nearest" });
  }

  end() {
    this.mark();
    this.dialog.close();
    document.cookie = `${SEEN}; max-age=31536000; path=/; SameSite=Strict`;
    byId("tour-begin").focus({ preventScroll: true });
  }
}
