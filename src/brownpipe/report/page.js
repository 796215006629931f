"use strict";
// Shows the values of the point of a figure that is nearest to the pointer, or chosen by the arrow keys.
const REACH = { mouse: 40, pen: 40, touch: 70 };  // farthest point that is shown [CSS pixel]

for (const plot of document.querySelectorAll(".plot")) {
  const { size, panels } = JSON.parse(plot.querySelector("script").textContent);
  const mark = plot.querySelector(".mark"), value = plot.querySelector(".value");
  const lines = panels.flatMap(panel => panel.series.map(series => ({ panel, ...series })));
  let line = 0, at = -1;  // the point that is shown: its series and its number; -1 for none

  function place(point) {
    return [point[0] / size[0] * plot.clientWidth, point[1] / size[1] * plot.clientHeight];
  }

  function words({ panel, name }, point) {
    const quantity = (label, amount) => (label ? label + " = " : "") + amount;
    const [, , x, y, low, high] = point;
    const interval = low === undefined ? "" : "95 % interval " + low + " to " + high;
    return [name, panel.title, quantity(panel.x, x), quantity(panel.y, y), interval].filter(Boolean).join("\n");
  }

  function show(number, index) {
    line = number;
    at = index;
    const point = lines[line].points[at], [x, y] = place(point), view = plot.parentElement;
    value.textContent = words(lines[line], point);
    mark.hidden = false;
    mark.style.left = x + "px";
    mark.style.top = y + "px";
    const width = value.offsetWidth, right = view.scrollLeft + view.clientWidth;
    const fits = [x + 14 + width <= right, x - 14 - width >= view.scrollLeft];  // on the right, on the left
    const left = fits[0] ? x + 14 : fits[1] ? x - 14 - width : Math.max(view.scrollLeft, Math.min(x, right - width));
    const end = plot.clientHeight - value.offsetHeight, beside = fits[0] || fits[1];
    const top = beside ? Math.min(y - 10, end) : y + 14 <= end ? y + 14 : y - 14 - value.offsetHeight;
    value.style.left = left + "px";
    value.style.top = Math.max(0, top) + "px";
  }

  function hide() {
    at = -1;
    mark.hidden = true;
    value.textContent = "";
  }

  function nearest(x, y, numbers) {
    let found = [Infinity, 0, 0];
    for (const number of numbers) {
      lines[number].points.forEach((point, index) => {
        const [px, py] = place(point), distance = Math.hypot(px - x, py - y);
        if (distance < found[0]) found = [distance, number, index];
      });
    }
    return found;
  }

  function follow(event) {
    const box = plot.getBoundingClientRect();
    const [distance, number, index] = nearest(event.clientX - box.left, event.clientY - box.top, lines.keys());
    if (distance > REACH[event.pointerType || "mouse"]) hide();
    else if (number !== line || index !== at) show(number, index);
  }

  function step(event) {
    const last = lines[line].points.length - 1;
    const other = { ArrowUp: -1, ArrowDown: 1 }[event.key];
    const index = { ArrowLeft: Math.max(0, at - 1), ArrowRight: Math.min(last, at + 1), Home: 0, End: last }[event.key];
    if (event.key === "Escape") return hide();
    if (other === undefined && index === undefined) return;
    event.preventDefault();
    if (other === undefined || at < 0) show(line, index ?? 0);
    else {
      const number = (line + other + lines.length) % lines.length;
      show(number, nearest(...place(lines[line].points[at]), [number])[2]);
    }
    mark.scrollIntoView({ block: "nearest", inline: "nearest" });
  }

  if (!lines.length) continue;
  plot.addEventListener("pointermove", follow);
  plot.addEventListener("pointerdown", follow);
  plot.addEventListener("pointerleave", event => event.pointerType === "mouse" && hide());
  plot.addEventListener("keydown", step);
  plot.addEventListener("blur", hide);
}
