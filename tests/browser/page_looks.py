"""What makes a page hard to read or to press, as scripts that run in it."""

import sys
from pathlib import Path

AXE = Path(sys.prefix) / "axe/node_modules/axe-core/axe.min.js"
"""Put there by tests/browser/install_chromium.sh, where npm is."""
SERIOUS = """async () => (await axe.run()).violations.filter(each => ["serious", "critical"].includes(each.impact))
  .map(each => `${each.id}: ${each.nodes.map(node => node.target)}`)"""

# Texts whose colour stands out from what is behind them by less than 4.5:1 (WCAG AA).
FAINT = """() => {
  const light = (rgb) => rgb.map(v => v / 255).map(v => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [.2126, .7152, .0722][i], 0);
  const parse = (text) => text.match(/[\\d.]+/g).map(Number);
  const behind = (node) => {
    for (; node; node = node.parentElement) {
      const colour = parse(getComputedStyle(node).backgroundColor);
      if (colour.length < 4 || colour[3] > 0) return colour.slice(0, 3);
    }
    return [255, 255, 255];
  };
  const faint = [];
  for (const node of document.querySelectorAll('main *, header *')) {
    if (node.closest('svg') || node.closest('.unseen') || !node.offsetParent) continue;
    if (![...node.childNodes].some(c => c.nodeType === 3 && c.textContent.trim())) continue;
    const [a, b] = [light(parse(getComputedStyle(node).color).slice(0, 3)), light(behind(node))];
    const ratio = (Math.max(a, b) + .05) / (Math.min(a, b) + .05);
    if (ratio < 4.5) faint.push(`${node.className} ${node.textContent}: ${ratio.toFixed(2)}`);
  }
  return faint;
}"""
# Everything that is pressed and lower than a fingertip.
SMALL = """() => [...document.querySelectorAll('main button, main summary, header button, input:not([type=radio])')]
  .filter(node => node.offsetParent && node.getBoundingClientRect().height < 40)
  .map(node => node.textContent || node.id)"""
# Parts of the page that lie over each other.
COVERED = """() => {
  const parts = [...document.querySelectorAll('main > *')].filter(node => node.offsetParent);
  const boxes = parts.map(node => [node.id || node.className, node.getBoundingClientRect()]);
  return boxes.flatMap(([one, a], n) => boxes.slice(n + 1).filter(([, b]) => a.top < b.bottom - 1
    && b.top < a.bottom - 1 && a.left < b.right - 1 && b.left < a.right - 1).map(([other]) => `${one} ${other}`));
}"""
NO_SIDEWAYS_SCROLLING = "document.documentElement.scrollWidth <= innerWidth"


def serious_findings(page):
    """What axe-core finds in a page that keeps somebody from using it; nothing where axe-core is missing."""
    if not AXE.is_file():
        return []
    page.evaluate(AXE.read_text("utf-8"))
    return page.evaluate(SERIOUS)
