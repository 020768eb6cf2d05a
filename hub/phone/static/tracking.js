// The pose model, and what its 33 landmarks say about the parts of the body (observer/tracking/pose.py has the same).
import { PoseLandmarker } from "/model/vision_bundle.mjs";

const LEFT = { hand: [15, 17, 19], elbow: [13], shoulder: [11], hip: [23], knee: [25], foot: [27, 31] };
const MIDDLE = { head: [7, 8], neck: [11, 12], pelvis: [23, 24] };
export const PARTS = {
  ...Object.fromEntries(Object.entries(LEFT).map(([part, marks]) => [`left_${part}`, marks])),
  ...Object.fromEntries(Object.entries(LEFT).map(([part, marks]) => [`right_${part}`, marks.map((mark) => mark + 1)])),
  ...MIDDLE,
};
const FAINT = 0.2; // the model's place of a hidden part is no guess worth sending
const MOVES = 0.15; // body heights a second: slower than any movement, faster than the model's noise
const CALM_MS = 2000;
const FAST_MS = 1000 / 20;
const CALM_EVERY_MS = 1000 / 6; // less than 6 Hz makes verdicts late
const SLOW_MS = 90; // a look that takes longer gets the smaller model
const TOO_SLOW_MS = 800; // and with the way the tracks are a second old, after which they are dropped
const LOOKS = 12;

export async function loadPose(small) {
  const simd = WebAssembly.validate(
    new Uint8Array([0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11]),
  );
  const name = `/model/vision_wasm_${simd ? "" : "nosimd_"}internal`;
  const files = { wasmLoaderPath: `${name}.js`, wasmBinaryPath: `${name}.wasm` };
  const options = (delegate) => ({
    baseOptions: { modelAssetPath: `/model/pose_${small ? "lite" : "full"}.task`, delegate },
    runningMode: "VIDEO",
    numPoses: 1,
  });
  if (hasGraphicsCard()) {
    try {
      return await PoseLandmarker.createFromOptions(files, options("GPU"));
    } catch (error) {
      console.warn("the pose model does not run on the graphics card:", String(error));
    }
  }
  return PoseLandmarker.createFromOptions(files, options("CPU"));
}

// A software renderer would be slower than the processor's own instructions.
function hasGraphicsCard() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = gl ? String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER)) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return gl !== null && !/swiftshader|llvmpipe|software|basic render/i.test(name);
}

// 33 landmarks (shares of the picture) -> {part: [u, v, confidence] or null}, px.
export function partsOf(landmarks, width, height) {
  const parts = {};
  for (const [part, marks] of Object.entries(PARTS)) {
    parts[part] = null;
    if (!landmarks) continue;
    const mean = (key) => marks.reduce((sum, mark) => sum + landmarks[mark][key], 0) / marks.length;
    const [u, v, sure] = [mean("x"), mean("y"), mean("visibility")];
    const inside = u >= 0 && u < 1 && v >= 0 && v < 1;
    if (inside && sure >= FAINT) {
      const round = (value) => Math.round(value * 100) / 100;
      parts[part] = [round(u * width), round(v * height), Math.min(1, round(sure))];
    }
  }
  return parts;
}

// When to look next: often while the person moves, seldom otherwise, and when the smaller model is needed.
export class Pace {
  #last = null;
  #movedMs = 0;
  #times = [];

  note(parts, atMs, tookMs) {
    this.#times.push(tookMs);
    if (this.#times.length > LOOKS) this.#times.shift();
    const places = Object.entries(parts).filter(([, place]) => place && place[2] >= 0.5);
    if (this.#last && places.length) {
      const rows = places.map(([, place]) => place[1]);
      const height = Math.max(...rows) - Math.min(...rows) || 1;
      const seconds = Math.max(atMs - this.#last.atMs, 1) / 1000;
      const moved = places.some(([part, [u, v]]) => {
        const before = this.#last.parts[part];
        return before && Math.hypot(u - before[0], v - before[1]) > MOVES * height * seconds + 0.01 * height;
      });
      if (moved || places.some(([part]) => !this.#last.parts[part])) this.#movedMs = atMs;
    } else if (places.length) this.#movedMs = atMs;
    this.#last = { parts, atMs };
  }

  isDue(atMs) {
    if (!this.#last) return true;
    const every = atMs - this.#movedMs < CALM_MS ? FAST_MS : CALM_EVERY_MS;
    return atMs - this.#last.atMs >= every - 4; // pictures come every 33 ms, not on the millisecond
  }

  get isCalm() {
    return this.#last !== null && this.#last.atMs - this.#movedMs >= CALM_MS;
  }

  get isSlow() {
    return this.#medianMs > SLOW_MS;
  }

  get isTooSlow() {
    return this.#medianMs > TOO_SLOW_MS;
  }

  get #medianMs() {
    return this.#times.length === LOOKS ? [...this.#times].sort((a, b) => a - b)[LOOKS / 2] : 0;
  }

  forgetTimes() {
    this.#times = [];
  }
}
