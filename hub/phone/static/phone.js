// The page of a phone that is a camera: it looks at its own pictures, and sends only tracks and its state.
import { Connection, nowMs } from "/connection.js";
import { draw } from "/drawing.js";
import { loadPose, Pace, partsOf } from "/tracking.js";

const element = (id) => document.getElementById(id);
const [video, canvas, view] = ["video", "drawing", "view"].map(element);
const REPORT_MS = 2000;
const pace = new Pace();
let [pose, small, loading] = [null, false, false];
let [facing, paused, stream, looks, reportedMs] = ["environment", false, null, 0, 0];
let [lastMs, lockedScreen, fault] = [0, null, ""];
const faults = { connection: "", camera: "", model: "" };

function showFault(of, text) {
  faults[of] = text;
  fault = Object.values(faults).find((each) => each) ?? "";
  element("fault").textContent = fault;
  element("fault").hidden = !fault;
}

const connection = new Connection({
  state: (text) => (element("state").textContent = text),
  welcome: (data) => {
    element("scene").textContent = data.scene;
    element("observer").textContent = data.observer;
    showFault("connection", "");
    report();
  },
  words: showWords,
  ended: (text) => {
    element("state").textContent = "not connected";
    showFault("connection", text);
  },
});

function showWords(words) {
  const { verdict, own, judged } = words;
  element("verdict").textContent = verdict ? verdict.label : "nothing decided yet";
  const time = verdict ? new Date(verdict.began_ms).toLocaleTimeString() : "";
  element("agreement").textContent = verdict ? `${verdict.k} of ${verdict.n} agreed, ${time}` : "";
  element("decided").classList.toggle("now", Boolean(verdict && !verdict.ended));
  const percent = (each) => `${each.label} ${Math.round(100 * each.p)} %`;
  const waits = words.observer === "silent" ? "its observer does not run: labanmesh up" : "sees no movement";
  element("own").textContent =
    `This camera: ${own ? percent(own) : waits}. ` + (judged && words.moves ? `Referee: ${percent(judged)}.` : words.why);
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
  if (connection.isOpen) element("state").textContent = paused ? "paused" : `${state}, ${hz} pictures a second`;
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
  openCamera();
};
element("pause").onclick = (event) => {
  paused = !paused;
  event.target.textContent = paused ? "Go on" : "Pause";
  report();
};

keepScreenOn();
await Promise.all([openCamera(), loadModel()]);
look();
