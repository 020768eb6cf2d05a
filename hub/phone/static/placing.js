// Where to stand, and how to place the phone: what of the body has not been seen lately.
const SEEN = 0.5;
const LATELY_MS = 2000; // a hand may be hidden for a moment in any movement
const FEET = ["left_foot", "right_foot"];
const HANDS = ["left_hand", "right_hand"];

export class Placing {
  #seenMs = {};

  note(parts, atMs) {
    for (const [part, place] of Object.entries(parts)) if (place && place[2] >= SEEN) this.#seenMs[part] = atMs;
  }

  // What to do, "" if all is well; and whether head and hands are seen, without which nothing is recognised.
  advice(atMs) {
    const missing = (part) => !(atMs - this.#seenMs[part] < LATELY_MS);
    if (Object.keys(this.#seenMs).every(missing))
      return ["Nobody is in the picture. Prop the phone up, and stand three steps before it.", false];
    if (missing("head")) return ["Your head is not in the picture: step back, or tilt the phone up.", false];
    if (HANDS.some(missing)) return ["A hand is not seen: step back, or face the phone.", false];
    if (FEET.some(missing)) return ["Your feet are not in the picture, so movements of the legs are not seen: step back.", true];
    return ["", true];
  }
}
