// Bodies and the ways of hands as cameras saw them, drawn from tracks. Pure.
import { draw } from "./elements.js";

const UNITS = 1000;
const BONES = [["head", "neck"], ["neck", "pelvis"], ...["left", "right"].flatMap((side) => [
  ["neck", `${side}_shoulder`], [`${side}_shoulder`, `${side}_elbow`], [`${side}_elbow`, `${side}_hand`],
  ["pelvis", `${side}_hip`], [`${side}_hip`, `${side}_knee`], [`${side}_knee`, `${side}_foot`]])];

/* Where the parts were, in the unit of the tracks: left, top, right, bottom. */
export function extent(tracks) {
  const seen = (first) => tracks.points.filter((value, i) => i % 2 === first && value >= 0 && tracks.points[i + 1 - 2 * first] >= 0).map((value) => value / UNITS * tracks.size + (first ? tracks.top : tracks.left));
  const [u, v] = [seen(0), seen(1)];
  return [Math.min(...u), Math.min(...v), Math.max(...u), Math.max(...v)];
}
export function square([left, top, right, bottom]) {
  const size = Math.max(right - left, bottom - top) || 1;
  return { left: (left + right - size) / 2, top: (top + bottom - size) / 2, size };
}
/* The body of the last frame and the ways of the hands before it, in a square of thousandths. */
export function figure(tracks, box) {
  const parts = tracks.body_parts, frames = Math.floor(tracks.points.length / (2 * parts.length));
  const place = (value, own, origin) => (value / UNITS * tracks.size + own - origin) / box.size * UNITS;
  const at = (frame, part) => {
    const i = 2 * (frame * parts.length + part), [u, v] = [tracks.points[i], tracks.points[i + 1]];
    return u < 0 || v < 0 ? null : [place(u, tracks.left, box.left), place(v, tracks.top, box.top)];
  };
  const range = [...Array(frames).keys()];
  const last = (name) => parts.includes(name) ? range.map((frame) => at(frame, parts.indexOf(name))).reverse().find(Boolean) || null : null;
  const head = last("head"), hands = ["left", "right"].map((side) => [side, last(`${side}_hand`)]).filter(([, hand]) => hand);
  const way = (side) => range.map((frame) => at(frame, parts.indexOf(`${side}_hand`))).filter(Boolean).map((point) => point.map(Math.round).join(",")).join(" ");
  return [
    ...(parts.length <= 3 ? arms(head, hands) : BONES.map(([one, other]) => [last(one), last(other)]).filter(([one, other]) => one && other)
      .map(([[x1, y1], [x2, y2]]) => draw("line", { class: "bone", x1, y1, x2, y2 }))),
    ...hands.map(([side]) => draw("polyline", { class: `trail ${side}`, points: way(side) })),
    ...hands.map(([side, [cx, cy]]) => draw("circle", { class: `hand ${side}`, cx, cy, r: 42 })),
    ...(head ? [draw("circle", { class: "head", cx: head[0], cy: head[1], r: 75 })] : []),
  ];
}
/* Of a body of which only head and hands are known: arms that begin at shoulders below the head. */
function arms(head, hands) {
  if (!head) return [];
  const neck = [head[0], head[1] + 130];
  return hands.map(([side, [x, y]]) => {
    const out = Math.sign(x - head[0]) || (side === "left" ? 1 : -1), shoulder = [neck[0] + 110 * out, neck[1] + 50];
    const elbow = [(shoulder[0] + x) / 2 + 70 * out, (shoulder[1] + y) / 2];
    return draw("path", { class: "bone", d: `M${head[0]} ${head[1]} L${neck} L${shoulder} Q${elbow} ${x} ${y}` });
  });
}
