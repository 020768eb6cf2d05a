// What each of several people does now, and the names that users give them.
import { $, button, hide, make, part, put, rowsOf, stored } from "./elements.js";
import { giveName, nameOf, words } from "./words.js";

const NAME_LIMIT = 32;

export function showPeople(people) {
  hide($("people"), people.length === 0);
  rowsOf($("people"), people.length, () => make("li", "", make("span", "who"), make("span"))).forEach((row, n) => {
    const { person, words: line } = people[n];
    if (!row.querySelector("input")) showName(row.firstChild, person);
    put(row.lastChild, ` ${words(line.slice(person.length + 1).trim())}`);
  });
}
/* The service keeps the name for all browsers. Who may not teach gives it in this browser alone. */
async function send(person, name) {
  const key = stored("teach-key"), headers = { "content-type": "application/json", ...(key ? { authorization: `Bearer ${key}` } : {}) };
  try { return (await fetch("people", { method: "POST", headers, body: JSON.stringify({ person, name }) })).ok; } catch { return false; }
}
function showName(place, person) {
  part(place, [person, nameOf(person)], () => {
    const node = button(nameOf(person), () => askName(place, person), "small-button");
    node.title = "Give this person a name";
    return [node];
  });
}
/* Until Enter, or the next touch elsewhere, the name is a field; an empty name is the scene's. */
function askName(place, person) {
  const field = make("input");
  Object.assign(field, { type: "text", maxLength: NAME_LIMIT, value: nameOf(person), size: 12 });
  field.setAttribute("aria-label", `Name of ${person}`);
  let done = false;
  const end = (keep) => {
    if (done) return;
    done = true;
    const name = field.value.trim();
    if (keep && name !== nameOf(person)) giveName(person, name === person ? "" : name, () => send(person, name === person ? "" : name));
    delete place.dataset.built;
    place.replaceChildren();
    showName(place, person);
    place.firstChild.focus();
  };
  field.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" && event.key !== "Escape") return;
    event.preventDefault();  // or it presses the button, which has the focus then
    end(event.key === "Enter");
  });
  field.addEventListener("blur", () => end(true));
  place.replaceChildren(field);
  field.select();
}
