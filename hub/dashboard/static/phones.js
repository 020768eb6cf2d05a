// "Use a phone": the code of each observer that sees through a phone, or its phone, as `labanmesh phone` has them.
import { $, attribute, command, draw, hide, make, part, stored } from "./elements.js";
import { clock } from "./words.js";

const EVERY_MS = 2000, MARGIN = 4; // Modules around a code (ISO/IEC 18004).
let setup = null, again = 0;

/* To be called with each snapshot. */
export function offerPhones(whole) {
  setup = whole;
  hide($("use-phone"), !setup.phones.length);
  if (!setup.phones.length) toggle(false);
}
const isOpen = () => !$("phones").hidden;
function toggle(open) {
  hide($("phones"), !open);
  attribute($("use-phone"), "aria-expanded", open);
  clearTimeout(again);
  if (open) ask(); else part($("phones"), null, () => []);
}
/* Asks again and again while the panel is open and seen, because a code is used or renewed elsewhere. */
async function ask() {
  clearTimeout(again);
  if (!isOpen() || document.hidden) return;
  const key = stored("teach-key");
  let answer = null, body = null;
  try {
    answer = await fetch("phones", { cache: "no-store", headers: key ? { authorization: `Bearer ${key}` } : {} });
    body = answer.ok ? await answer.json() : (await answer.text()).trim();
  } catch { answer = null; }
  if (!isOpen()) return;
  if (answer) show(answer, body);
  // A browser that lacks the token does not get it by asking.
  if (!answer || ![401, 403, 429].includes(answer.status)) { clearTimeout(again); again = setTimeout(ask, EVERY_MS); }
}
const verb = (...words) => ["labanmesh", ...words].join(" ");
function show(answer, body) {
  if (answer.ok) part($("phones"), body, () => [make("h2", "", "A phone as a camera"), make("div", "codes", ...body.map(phone))]);
  else if (answer.status === 503) part($("phones"), body, () => [make("p", "", `${body}. Start it there:`), command(verb("phone", setup.file))]);
  else part($("phones"), [body, setup.teaches], () => lacking(answer.status === 403 ? "A code makes a phone a camera, so that to see one needs the right to teach." : body));
}
function lacking(line) {
  if (!setup.teaches) return [make("p", "", `${line} Start this page with it:`), command(verb("dashboard", setup.file, "--teach"))];
  return [make("p", "", `${line} Enter the token once on the `, link("Teach page", "teach"), ".")];
}
function link(text, address) {
  const node = make("a", "", text);
  node.href = address;
  return node;
}
/* One observer: its code until a phone has used it, then that phone. */
function phone(each) {
  const title = make("h3", "", each.observer);
  if (!each.link) {
    const name = each.phone || "The phone";
    const state = each.live ? [`${name} is its camera.`] : [`Its phone, ${name}, is not here now. Open this on it: `, link(each.address, each.address)];
    return make("div", "code", title, make("p", "", ...state), make("p", "quiet", "For another phone, end this one:"), command(verb("phone", setup.file, "--revoke", each.observer)));
  }
  const words = `Scan it with the phone's camera, which becomes that of ${each.observer}, or open this on the phone:`;
  return make("div", "code", title, qr(each.modules, each.observer), make("p", "", words), make("p", "address", link(each.link, each.link)), make("p", "quiet", `Good for one phone, until ${clock(each.expires)}.`));
}
function qr(rows, observer) {
  const wide = rows.length + 2 * MARGIN;
  const dark = rows.map((row, y) => [...row.matchAll(/1+/g)].map((run) => `M${run.index} ${y}h${run[0].length}v1h-${run[0].length}z`).join("")).join("");
  const place = { x: -MARGIN, y: -MARGIN, width: wide, height: wide };
  return draw("svg", { class: "qr", viewBox: `${-MARGIN} ${-MARGIN} ${wide} ${wide}`, role: "img", "aria-label": `QR code for ${observer}` }, draw("rect", place), draw("path", { d: dark }));
}
$("use-phone").addEventListener("click", () => toggle(!isOpen()));
document.addEventListener("visibilitychange", ask);
