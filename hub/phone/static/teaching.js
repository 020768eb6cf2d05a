// What to do next, always on the page: place the phone, choose movements, the lesson, then see one recognised.
import { $, button, hide, make, part, put, showAdvice } from "/elements.js";
import { listed, listen, showLesson } from "/lesson.js";
import { words as plain } from "/words.js";

const LOOK_MS = 2000; // the server takes a page that has not asked for 5 s as gone
const IDEAS = ["wave", "point", "clap", "circle", "stop"];
const LABEL = /^[a-z0-9_]{1,64}$/;

export class Teaching {
  #connection;
  #words = null;
  #chosen = [];
  #isOpen = false;
  #lookedMs = 0;

  constructor(connection) {
    this.#connection = connection;
    addEventListener("pointerdown", listen); // browsers are silent before the first touch
    $("setup").onsubmit = (event) => {
      event.preventDefault();
      if (this.#add($("label").value)) $("label").value = "";
    };
    $("start").onclick = () => this.#begin();
    $("teach").onclick = () => {
      this.#isOpen = !this.#isOpen;
      this.#show("", true);
    };
    $("stop").onclick = () => this.#stop(this.#lesson.id);
  }

  // words: of the server; line: how the connection is, "" for well; advice, isSeen: of Placing.
  show(words, line, [advice, isSeen]) {
    this.#words = line ? null : words;
    hide($("next"), false);
    if (!this.#words) {
      showAdvice($("next"), line ? [line, ""] : null);
      hide($("setup"), true);
      return;
    }
    this.#show(advice, isSeen);
    const looks = words.teaches && !document.hidden && (this.#lesson || !$("setup").hidden || !this.#known.length);
    if (looks && performance.now() - this.#lookedMs > LOOK_MS) {
      this.#lookedMs = performance.now();
      this.#connection.ask({ ask: "look" });
    }
  }

  complain(text) {
    put($("complaint"), text);
    hide($("complaint"), !text);
  }

  get #lesson() {
    return this.#words?.lesson?.lesson ?? null;
  }

  get #known() {
    return this.#words?.lesson?.known ?? this.#words?.known ?? [];
  }

  #show(advice, isSeen) {
    const lesson = this.#lesson;
    const runs = this.#words.observer !== "silent";
    const choosing = this.#words.teaches && !lesson && runs && (this.#isOpen || !this.#known.length);
    document.body.dataset.mode = lesson ? "lesson" : choosing ? "setup" : "watch";
    hide($("setup"), !choosing);
    hide($("lesson"), !lesson);
    hide($("stop"), !lesson || lesson.over);
    hide($("teach"), !this.#words.teaches || Boolean(lesson) || !runs || !this.#known.length);
    put($("teach"), this.#isOpen ? "Not now" : "Teach more");
    if (choosing) this.#showChoice();
    if (lesson) showLesson(this.#words.lesson, this.#acts(lesson));
    // In a lesson the stage says it; but nobody can begin a take unseen.
    const waits = !lesson || (lesson.waits && lesson.step.label);
    showAdvice($("next"), waits ? this.#next(advice, isSeen, runs, choosing) : null);
  }

  #next(advice, isSeen, runs, choosing) {
    if (!runs) return ["This camera's observer does not run. On the machine that showed the code:", `labanmesh up ${this.#words.file}`];
    if (!isSeen || this.#lesson) return advice ? [advice, ""] : null;
    if (choosing) return [this.#known.length ? "Choose what it shall learn, too." : "It knows no movement yet. Choose at least two, then begin.", ""];
    if (!this.#known.length) return ["It knows no movement yet. On the machine that showed the code:", `labanmesh teach ${this.#words.file} wave point`];
    return [`Do one: ${listed(this.#known)}. ${advice}`, ""];
  }

  #showChoice() {
    const known = this.#known;
    const begun = this.#words.lesson?.begun ?? [];
    const ideas = IDEAS.filter((each) => !this.#chosen.includes(each) && !known.includes(each)).slice(0, 3);
    part($("chosen"), [this.#chosen, ideas, begun], () => [
      ...this.#chosen.map((label) => this.#chip(plain(label), `Leave out ${plain(label)}`, "chosen", () => this.#choose(this.#chosen.filter((each) => each !== label)))),
      ...ideas.map((label) => this.#chip(`+ ${plain(label)}`, `Add ${plain(label)}`, "", () => this.#add(label))),
      ...(begun.length ? [this.#chip(`Go on with ${listed(begun)}`, `Go on with ${listed(begun)}`, "", () => this.#start({ labels: begun }))] : []),
    ]);
    $("start").disabled = this.#chosen.length + known.length < 2 || !this.#chosen.length;
  }

  #chip(text, name, kind, act) {
    const node = button(text, act, kind);
    node.setAttribute("aria-label", name);
    return make("li", "", node);
  }

  #choose(labels) {
    this.#chosen = labels;
    this.#showChoice();
  }

  #add(text) {
    const label = text.trim().toLowerCase().replace(/[\s-]+/g, "_");
    const wrong = !LABEL.test(label) ? "Use letters from a to z, digits and spaces in the name of a movement."
      : this.#chosen.includes(label) ? `${plain(label)} is chosen already.` : "";
    this.complain(wrong);
    if (!wrong) this.#choose([...this.#chosen, label]);
    return !wrong;
  }

  #begin() {
    if ($("label").value.trim() && !this.#add($("label").value)) return;
    $("label").value = "";
    if (this.#start({ labels: this.#chosen })) this.#chosen = [];
  }

  #start(plan) {
    this.#isOpen = false;
    return this.#connection.ask({ ask: "start", plan: { add: this.#known.length > 0, ...plan } });
  }

  #stop(lesson) {
    return this.#connection.ask({ ask: "stop", lesson });
  }

  #acts(lesson) {
    return {
      press: (action, take = 0) => this.#connection.ask({ ask: "press", lesson: lesson.id, number: lesson.number, action, take }),
      start: (plan) => this.#start(plan),
      stop: (id) => this.#stop(id),
      ways: () => [],
      review: "If one went wrong, make one more.",
      next: "See it recognised",
    };
  }
}
