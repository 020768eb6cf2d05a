// The WebSocket: it shows the code once, keeps the secret that it got for it, and comes back by itself.
const SECRET = "labanmesh-phone";
const UNACKNOWLEDGED = 4; // tracks on the way; what a slow line holds up is never older than these
const SILENT_MS = 4000; // the server asks for the clock each second
const REFUSED = 4000;
const REPLACED = 4001;

export const nowMs = () => performance.timeOrigin + performance.now();

export class Connection {
  #socket = null;
  #sent = 0;
  #taken = 0;
  #waiting = null;
  #heard = 0;
  #tries = 0;
  #timer = 0;
  #code = "";

  // on: {state(text), welcome(data), words(data), complaint(text), ended(text)}
  constructor(on) {
    this.on = on;
    this.#code = location.hash.slice(1);
    history.replaceState(null, "", location.pathname); // the code works once, and stands in no history
    addEventListener("online", () => this.#again(0));
    document.addEventListener("visibilitychange", () => document.hidden || this.#again(0));
    setInterval(() => this.#check(), 1000);
    this.#open();
  }

  get isOpen() {
    return this.#socket?.readyState === WebSocket.OPEN && this.welcomed;
  }

  // Only the newest tracks wait.
  send(tracks) {
    this.#waiting = tracks;
    this.#flush();
  }

  report(camera) {
    if (this.isOpen) this.#put({ camera });
  }

  // Whether it could be sent: what is asked of a lesson does not wait for a lost line.
  ask(lesson) {
    if (this.isOpen) this.#put({ lesson });
    return this.isOpen;
  }

  #flush() {
    if (this.#waiting && this.isOpen && this.#sent - this.#taken < UNACKNOWLEDGED) {
      this.#put({ tracks: this.#waiting });
      this.#sent += 1;
      this.#waiting = null;
    }
  }

  #put(message) {
    this.#socket.send(JSON.stringify(message));
  }

  #open() {
    const secret = localStorage.getItem(SECRET);
    if (!this.#code && !secret) {
      this.on.ended("scan the code that labanmesh phone shows");
      return;
    }
    this.on.state(this.#tries ? "connecting again" : "connecting");
    const socket = new WebSocket(`wss://${location.host}/socket`);
    this.#socket = socket;
    this.welcomed = false;
    this.#heard = nowMs();
    socket.onopen = () =>
      socket.send(
        JSON.stringify(this.#code ? { join: { code: this.#code, name: browserName() } } : { resume: { secret } }),
      );
    socket.onmessage = (event) => this.#take(socket, JSON.parse(event.data));
    socket.onclose = (event) => this.#closed(socket, event);
  }

  #take(socket, message) {
    if (socket !== this.#socket) return;
    this.#heard = nowMs();
    if ("clock" in message) this.#put({ clock: { number: message.clock, now_ms: nowMs() } });
    else if ("taken" in message) this.#taken = message.taken;
    else if (message.welcome) this.#welcome(message.welcome);
    else if (message.words) this.on.words(message.words);
    else if ("complaint" in message) this.on.complaint(message.complaint);
    else if (message.ended) this.lastWords = message.ended;
    this.#flush();
  }

  #welcome(data) {
    if (data.secret) localStorage.setItem(SECRET, data.secret);
    this.#code = "";
    this.#tries = this.#sent = this.#taken = 0;
    this.#waiting = null;
    this.welcomed = true;
    this.on.state("connected");
    this.on.welcome(data);
  }

  #closed(socket, event) {
    if (socket !== this.#socket) return;
    this.#socket = null;
    if (event.code === REFUSED) {
      const text = this.lastWords || event.reason;
      // A phone that has a secret of its own and scans a used code stays what it is.
      if (this.#code && localStorage.getItem(SECRET)) {
        this.#code = "";
        this.#again(0);
        return;
      }
      localStorage.removeItem(SECRET);
      this.on.ended(text);
    } else if (event.code === REPLACED) this.on.ended("this page is open elsewhere on this phone; reload it to use it here");
    else {
      this.on.state(event.code === 1008 ? event.reason : "the connection is lost; trying again");
      this.#tries += 1;
      this.#again(Math.min(500 * 2 ** this.#tries, 5000));
    }
  }

  #again(afterMs) {
    if (this.#socket || this.stopped) return;
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#socket || this.#open(), afterMs);
  }

  // A socket whose other side is gone says so only after minutes.
  #check() {
    if (this.#socket && nowMs() - this.#heard > SILENT_MS) {
      const socket = this.#socket;
      this.#socket = null;
      socket.close();
      this.on.state("the connection is lost; trying again");
      this.#tries += 1;
      this.#again(Math.min(500 * this.#tries, 5000));
    }
  }
}

function browserName() {
  const agent = navigator.userAgent;
  const system = /iPhone|iPad|Android|Linux|Windows|Mac OS X/.exec(agent)?.[0] ?? "";
  const browser = /Firefox|EdgA?|OPR|Chrome|Safari/.exec(agent)?.[0] ?? "browser";
  return `${system} ${browser}`.trim();
}
