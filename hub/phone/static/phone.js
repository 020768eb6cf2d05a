// The page of a phone that is a camera: it looks at its own pictures, and sends only tracks and its state.
import { Connection, nowMs } from "/connection.js";
import { draw } from "/drawing.js";
import { Placing } from "/placing.js";
import { Teaching } from "/teaching.js";
import { loadPose, Pace, partsOf } from "/tracking.js";

const element = (id) => document.getElementById(id);
const [video, canvas, view] = ["video", "drawing", "view"].map(element);
const REPORT_MS = 2000;
const SHOW_MS = 300;
const FACING = "labanmesh-camera"; // which camera was chosen; at first the one beside the screen, which is read from afar
const [pace, placing] = [new Pace(), new Placing()];
let [pose, small, loading] = [null, false, false];
let [facing, paused, stream, looks, reportedMs] = [localStorage.getItem(FACING) ?? "user", false, null, 0, 0];
let [lastMs, lockedScreen, fault, words, line] = [0, null, "", null, "starting"];
let teaching = null;
const faults = { connection: "", camera: "", model: "", speed: "" };
const TOO_SLOW = "this phone needs a second for a picture, so that its tracks come too late: close other pages, or use another phone";

function showFault(of, text) {
  faults[of] = text;
  fault = Object.values(faults).find((each) => each) ?? "";
  element("fault").textContent = fault;
  element("fault").hidden = !fault;
}

const connection = new Connection({
  state: (text) => {
    element("state").textContent = line = text;
    showNext();
  },
  welcome: (data) => {
    line = "";
    element("scene").textContent = data.scene;
    element("observer").textContent = data.observer;
    showFault("connection", "");
    report();
  },
  words: showWords,
  complaint: (text) => teaching.complain(text),
  ended: (text) => {
    element("state").textContent = "not connected";
    line = "Scan a new code: labanmesh phone shows it.";
    showFault("connection", text);
    showNext();
  },
});
teaching = new Teaching(connection);

function showNext() {
  teaching?.show(words, line, pose ? placing.advice(nowMs()) : ["The pose model is loading, once: 10 MB.", false]);
}

function showWords(newWords) {
  words = newWords;
  showNext();
  const { verdict, own, judged } = words;
  element("verdict").textContent = verdict ? verdict.label : "nothing decided yet";
  const time = verdict ? new Date(verdict.began_ms).toLocaleTimeString() : "";
  element("agreement").textContent = verdict ? `${verdict.k} of ${verdict.n} agreed, ${time}` : "";
  element("decided").classList.toggle("now", Boolean(verdict && !verdict.ended));
  const percent = (each) => `${each.label} ${Math.round(100 * each.p)}%`;
  element("own").textContent =
    `This camera: ${own ? percent(own) : "sees no movement"}. ` + (judged && words.moves ? `Referee: ${percent(judged)}.` : words.why);
}

async function openCamera() {
  stream?.getTracks().forEach((track) => track.stop());
  try {
    stream = await navigator.mediaDevices.getUserMedia({
      audio: false,
      video: { facingMode: facing, width: { ideal: 640 }, height: { ideal: 480 }, frameRate: { ideal: 30 } },
    });
    const [track] = stream.getVideoTracks();
    const isFront = track.getSettings().facingMode === "user";
    view.classList.toggle("mirrored", isFront);
    track.onended = () => openCamera();
    video.srcObject = stream;
    await video.play();
    showFault("camera", "");
  } catch (error) {
    const text = navigator.mediaDevices ? `no camera: ${error.name}: allow it for this page` : "no camera: the page is not trusted";
    showFault("camera", text);
    setTimeout(() => paused || document.hidden || openCamera(), 3000);
  }
}

async function loadModel() {
  if (loading) return;
  loading = true;
  try {
    const next = await loadPose(small);
    pose?.close();
    pose = next;
    pace.forgetTimes();
    showFault("model", "");
  } catch (error) {
    showFault("model", `the pose model cannot be loaded: ${error.message ?? error}`);
    setTimeout(loadModel, 5000);
  }
  loading = false;
}

function look(now, picture) {
  video.requestVideoFrameCallback ? video.requestVideoFrameCallback(look) : requestAnimationFrame(look);
  const atMs = nowMs();
  if (!pose || paused || video.readyState < 2 || !pace.isDue(atMs)) return;
  // When the picture was taken, where the browser knows it; a number far off is another clock.
  const taken = picture?.captureTime ? performance.timeOrigin + picture.captureTime : atMs;
  const began = performance.now();
  lastMs = Math.max(lastMs + 1, Math.round(began)); // the model wants times that grow
  let landmarks;
  try {
    landmarks = pose.detectForVideo(video, lastMs).landmarks[0];
  } catch (error) {
    showFault("model", `the pose model stopped: ${error.message ?? error}`);
    pose = null;
    loadModel();
    return;
  }
  const parts = partsOf(landmarks, video.videoWidth, video.videoHeight);
  pace.note(parts, atMs, performance.now() - began);
  placing.note(parts, atMs);
  showFault("speed", pace.isTooSlow && small && !loading ? TOO_SLOW : "");
  connection.send({ at_ms: Math.abs(atMs - taken) < 500 ? Math.min(taken, atMs) : atMs, parts });
  draw(canvas, video, parts);
  looks += 1;
  if (atMs - reportedMs > REPORT_MS) report();
  if (pace.isSlow && !small && !loading) {
    small = true;
    loadModel();
  }
}

function report() {
  const seconds = (nowMs() - reportedMs) / 1000;
  const hz = Math.round((10 * looks) / seconds) / 10;
  [looks, reportedMs] = [0, nowMs()];
  const state = fault ? "failed" : document.hidden ? "hidden" : paused || pace.isCalm ? "idle" : "running";
  connection.report({ state, hz: Math.min(hz, 1000), reason: fault.slice(0, 200) });
  if (connection.isOpen) element("state").textContent = paused ? "paused" : `${state}, ${Math.round(hz)} pictures/s`;
}

async function keepScreenOn() {
  if (document.hidden || !navigator.wakeLock) return;
  try {
    lockedScreen = await navigator.wakeLock.request("screen");
  } catch {
    lockedScreen = null; // as with little battery
  }
}

document.addEventListener("visibilitychange", () => {
  report();
  if (document.hidden) return;
  keepScreenOn();
  if (!stream?.active) openCamera();
  else video.play().catch(() => openCamera());
});
element("turn").onclick = () => {
  facing = facing === "user" ? "environment" : "user";
  localStorage.setItem(FACING, facing);
  openCamera();
};
element("pause").onclick = (event) => {
  paused = !paused;
  event.target.textContent = paused ? "Go on" : "Pause";
  report();
};

setInterval(showNext, SHOW_MS);
keepScreenOn();
await Promise.all([openCamera(), loadModel()]);
look();
