// What only a new render can show: asks for it after a rest, shows one picture after the other, and how far it is.
// @ts-check
import { ask } from "./picture.js";

const byId = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
/** Rest after a change before it is rendered, ms: a drag passes many values. */
const REST = 120;

export class Anew {
  /** @param {import("./changes.js").Changes} changes @param {import("./picture.js").Picture} picture
   * @param {(text: string, needsRender?: boolean) => void} say @param {() => void} over what follows the last picture */
  constructor(changes, picture, say, over) {
    this.changes = changes;
    this.picture = picture;
    this.say = say;
    this.over = over;
    /** The changes that are rendered, as text; empty where none are. */
    this.wanted = "";
    /** Changes whose render was stopped or failed, as text: only a wish renders them again. */
    this.given = "";
    /** Why they were not rendered. */
    this.reason = "";
    this.taken = new AbortController();
    /** @type {number | undefined} */
    this.timer = undefined;
    picture.onrender = (/** @type {boolean} */ isNeeded) => (isNeeded ? this.want() : this.leave());
    byId("veil-stop").addEventListener("click", () => {
      ask("/api/stop", {});
      this.giveUp("The render was stopped; the frame is that of the state before, or coarse.");
    });
    byId("render").addEventListener("click", () => {
      say("");
      this.wanted = this.given = "";
      this.want();
    });
  }

  /** Has what is shown rendered, unless it is. */
  want() {
    const wanted = JSON.stringify(this.changes.list());
    if (wanted === this.given) this.say(this.reason, true);
    if (wanted === this.wanted || wanted === this.given) return;
    this.given = "";
    this.wanted = wanted;
    byId("veil").hidden = false;
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.follow(JSON.parse(wanted)), REST);
  }

  /** What is shown now needs no render. */
  leave() {
    if (!this.wanted || this.wanted === JSON.stringify(this.changes.list())) return;
    ask("/api/stop", {});
    this.end();
  }

  /** @param {string} reason */
  giveUp(reason) {
    [this.given, this.reason] = [this.wanted, reason];
    this.end();
    this.say(reason, true);
  }

  end() {
    clearTimeout(this.timer);
    this.taken.abort();
    this.wanted = "";
    byId("veil").hidden = true;
    this.over();
  }

  /** @param {string[]} set */
  async follow(set) {
    this.taken.abort();
    const { signal } = (this.taken = new AbortController());
    try {
      for (/** @type {number | null} */ let seen = null; ; ) {
        const told = await (await ask("/api/render", { set, seen }, signal)).json();
        if (signal.aborted) return;
        byId("veil-text").textContent = `${told.level ? "Coarse" : "Stale"} · ${told.said || "rendering"} …`;
        byId("veil-share").value = told.share;
        if (told.error) throw new Error(told.error);
        seen ??= 0;
        if (told.level > seen) {
          seen = told.level;
          await this.picture.refresh();
        }
        if (told.is_over) return this.end();
      }
    } catch (error) {
      if (signal.aborted) return;
      this.giveUp(/** @type {Error} */ (error).message);
    }
  }
}
