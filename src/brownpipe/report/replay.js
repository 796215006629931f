// The replay of one run in the section around this script: report/replay.py says what its data are.
(() => {
  "use strict";
  const section = document.currentScript.closest(".brownpipe-replay");
  const part = (name) => section.querySelector(".brownpipe-replay-" + name);
  const run = JSON.parse(part("data").textContent);
  const isSmall = section.classList.contains("brownpipe-replay-small");  // beside other things on its page
  section.classList.add("brownpipe-replay-moves");  // in place of the picture of the start

  // --- the run

  const {time: eventTime, a, b, impulse} = run.collisions;  // b: the other disk, or a wall: -1 left, -2 right, ...
  const {radius, mass, shade} = run, disks = radius.length;
  const start = run.position.flat(), launch = run.velocity.flat();  // x, y of disk after disk
  const [left, right] = run.box.x, [bottom, top] = run.box.y, width = right - left, height = top - bottom;
  const low = [left, bottom], size = [width, height], {periodic} = run.box;  // of x and y
  const kinetic = (i, u, v) => 0.5 * mass[i] * (u * u + v * v);
  const total = mass.reduce((sum, _, i) => sum + kinetic(i, launch[2 * i], launch[2 * i + 1]), 0);  // conserved

  // The state at a time, by all collisions up to it; `visit(n, x, v)` is called after each.
  function fly(time, visit) {
    const x = start.slice(), v = launch.slice(), since = new Float64Array(disks);
    let done = 0;
    for (; done < eventTime.length && eventTime[done] <= time; done++) {
      for (const [i, sign] of [[a[done], 1], [b[done], -1]]) {
        if (i < 0) continue;  // a wall
        for (const axis of [0, 1]) {
          x[2 * i + axis] += v[2 * i + axis] * (eventTime[done] - since[i]);
          v[2 * i + axis] += sign * impulse[done][axis] / mass[i];
        }
        since[i] = eventTime[done];
      }
      if (visit) visit(done, x, v);
    }
    for (let k = 0; k < x.length; k++) x[k] += v[k] * (time - since[k >> 1]);
    return {x, v, done};
  }

  // The periodic image of the box, counted from the box itself, that a coordinate is in: 0 between walls.
  const image = (x, axis) => (periodic[axis] ? Math.floor((x - low[axis]) / size[axis]) : 0);
  const wrapped = (x, axis) => x - size[axis] * image(x, axis);
  const inBox = (x) => Array.from({length: disks}, (_, i) => [wrapped(x[2 * i], 0), wrapped(x[2 * i + 1], 1)]);

  // The tracer's path: its unwrapped position and velocity after each of its collisions.
  const path = [{t: 0, x: start[0], y: start[1], u: launch[0], v: launch[1]}];
  fly(run.end, (n, x, v) => {
    if (a[n] === 0 || b[n] === 0) path.push({t: eventTime[n], x: x[0], y: x[1], u: v[0], v: v[1]});
  });
  const legsUntil = (time) => path.filter((leg) => leg.t <= time);
  function squareAt(time) {
    const leg = legsUntil(time).at(-1), dt = time - leg.t;
    return (leg.x + leg.u * dt - start[0]) ** 2 + (leg.y + leg.v * dt - start[1]) ** 2;
  }

  // --- the picture

  const box = part("box"), colour = (name) => getComputedStyle(section).getPropertyValue("--" + name).trim();
  let now = 0, rate = 0, playing = false, drawn = 0, scale = 1;

  // Set the size of a canvas, sharp on every screen; return its context, in CSS pixels.
  function fitted(canvas, wide, high) {
    const dense = window.devicePixelRatio || 1, context = canvas.getContext("2d");
    canvas.width = Math.max(1, Math.round(wide * dense));
    canvas.height = Math.max(1, Math.round(high * dense));
    context.scale(canvas.width / wide, canvas.height / high);
    return context;
  }

  // The part of the box that is shown: all of it or, of a very long box, a window that follows the tracer.
  const elongation = 6;  // longer side of the picture over the shorter one at most
  const limited = (side) => Math.min(side, elongation * Math.min(width, height));
  const seen = {left, bottom, width: limited(width), height: limited(height)};
  function follow([x, y]) {
    seen.left = Math.min(Math.max(x - seen.width / 2, left), left + width - seen.width);
    seen.bottom = Math.min(Math.max(y - seen.height / 2, bottom), bottom + height - seen.height);
  }

  const margin = 3;  // for the walls [pixels]
  const toX = (x) => margin + (x - seen.left) * scale, toY = (y) => margin + (seen.bottom + seen.height - y) * scale;

  function circle(pen, x, y, i) {
    pen.beginPath();
    pen.arc(toX(x), toY(y), Math.max(1, radius[i] * scale), 0, 2 * Math.PI);
  }

  // Call draw(x, y) at a disk's place and at its images that reach into the box over periodic sides.
  function atImages(i, place, draw) {
    const shifts = (axis) => {
      const offset = place[axis] - low[axis];
      const reachesIn = (shift) => offset + shift > -radius[i] && offset + shift < size[axis] + radius[i];
      return periodic[axis] ? [0, size[axis], -size[axis]].filter(reachesIn) : [0];
    };
    for (const a of shifts(0)) for (const b of shifts(1)) draw(place[0] + a, place[1] + b);
  }

  // Draw the tracer's path so far, each leg in every periodic image that it crosses, up to the last 8.
  function drawPath(pen, end) {
    const points = legsUntil(now).concat(end);
    const images = (from, to) =>
      Array.from({length: Math.min(8, Math.abs(to - from)) + 1}, (_, k) => to - k * Math.sign(to - from));
    pen.beginPath();
    for (let k = 1; k < points.length; k++) {
      const p = points[k - 1], q = points[k];
      for (const a of images(image(p.x, 0), image(q.x, 0))) {
        for (const b of images(image(p.y, 1), image(q.y, 1))) {
          pen.moveTo(toX(p.x - a * width), toY(p.y - b * height));
          pen.lineTo(toX(q.x - a * width), toY(q.y - b * height));
        }
      }
    }
    pen.strokeStyle = colour("data");
    pen.lineWidth = 1.5;
    pen.stroke();
    pen.beginPath();  // where it began
    pen.arc(toX(start[0]), toY(start[1]), 2.5, 0, 2 * Math.PI);
    pen.fillStyle = colour("ground");
    pen.fill();
    pen.stroke();
  }

  function drawBox(state) {
    const room = part("stage").clientWidth - 2 * margin, places = inBox(state.x);
    follow(places[0]);
    const highest = isSmall ? 320 : 0.68 * Math.max(500, window.innerHeight);
    scale = Math.min(room / seen.width, highest / seen.height);
    const pixels = [seen.width * scale + 2 * margin, seen.height * scale + 2 * margin], pen = fitted(box, ...pixels);
    const whole = [toX(left), toY(top), width * scale, height * scale];
    [box.style.width, box.style.height] = pixels.map((side) => side + "px");
    pen.fillStyle = colour("ground");
    pen.fillRect(...whole);
    pen.save();
    pen.beginPath();
    pen.rect(...whole);
    pen.clip();
    const faces = [0, 1, 2, 3, 4].map((k) => colour("face-" + k)), rim = colour("rim"), data = colour("data");
    for (let i = disks - 1; i >= 0; i--) {  // the tracer last, on top
      pen.fillStyle = faces[shade[i]];
      pen.strokeStyle = i ? rim : data;
      pen.lineWidth = i ? 1 : 1.5;
      atImages(i, places[i], (x, y) => { circle(pen, x, y, i); pen.fill(); pen.stroke(); });
    }
    drawPath(pen, {x: state.x[0], y: state.x[1]});
    drawFlashes(pen, state.done, places);
    pen.restore();
    for (const x of [left, right]) drawSide(pen, [x, bottom], [x, top], periodic[0]);
    for (const y of [bottom, top]) drawSide(pen, [left, y], [right, y], periodic[1]);
  }

  // Draw a side of the box from one corner to another: thick for a wall, dashed where it is periodic.
  function drawSide(pen, from, to, isPeriodic) {
    pen.strokeStyle = colour("ink");
    pen.lineWidth = isPeriodic ? 1.5 : 2 * margin - 2;
    pen.lineCap = isPeriodic ? "butt" : "square";  // so that walls meet in the corners
    pen.setLineDash(isPeriodic ? [6, 4] : []);
    pen.beginPath();
    pen.moveTo(toX(from[0]), toY(from[1]));
    pen.lineTo(toX(to[0]), toY(to[1]));
    pen.stroke();
  }

  // Ring the disks that have collided within the last 0.25 s of the replay; the ring fades.
  function drawFlashes(pen, done, places) {
    const lasting = 0.25 * rate;
    pen.strokeStyle = colour("flash");
    pen.lineWidth = 2.5;
    for (let n = done - 1; n >= 0 && now - eventTime[n] < lasting; n--) {
      pen.globalAlpha = 1 - (now - eventTime[n]) / lasting;
      for (const i of [a[n], b[n]]) {
        if (i >= 0) atImages(i, places[i], (x, y) => { circle(pen, x, y, i); pen.stroke(); });
      }
    }
    pen.globalAlpha = 1;
  }

  // --- numbers and curves

  const digits = (x) => (x === 0 ? "0" : Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3 ? x.toExponential(2) : x.toPrecision(4));
  const decimals = Math.min(9, Math.max(0, 3 - Math.floor(Math.log10(run.end))));  // of the time
  const timeText = (t) => (run.end < 1e-5 || run.end >= 1e6 ? t.toExponential(3) : t.toFixed(decimals));

  function showNumbers(state) {
    const energy = mass.reduce((sum, _, i) => sum + kinetic(i, state.v[2 * i], state.v[2 * i + 1]), 0);
    const tracer = kinetic(0, state.v[0], state.v[1]);
    const values = {
      time: `${timeText(now)} of ${timeText(run.end)}`,
      collisions: state.done.toLocaleString("en"),
      hits: String(legsUntil(now).length - 1),
      energy: digits(energy),
      tracer: digits(tracer),
      bath: disks > 1 ? digits(energy - tracer) : "none",
      square: digits(squareAt(now)),
    };
    for (const cell of section.querySelectorAll("[data-number]")) cell.textContent = values[cell.dataset.number];
  }

  const steps = Array.from({length: 301}, (_, k) => (run.end * k) / 300);
  const curves = {square: steps.map((t) => [t, squareAt(t)]), energy: []};
  path.forEach((leg, k) => {
    const until = k + 1 < path.length ? path[k + 1].t : run.end, energy = kinetic(0, leg.u, leg.v);
    curves.energy.push([leg.t, energy], [until, energy]);
  });
  const bath = disks > 1 ? curves.energy.map(([t, energy]) => [t, (total - energy) / (disks - 1)]) : [];  // mean per disk

  function drawCurve(canvas, points, dashed) {
    const wide = canvas.clientWidth, high = canvas.clientHeight, pen = fitted(canvas, wide, high);
    const most = Math.max(...points.map((p) => p[1]), ...dashed.map((p) => p[1])) || 1, below = 18, above = 16;
    const atX = (t) => 1 + (wide - 2) * (t / run.end), atY = (y) => high - below - (high - below - above) * (y / most);
    const line = (some, name, thick, dash) => {
      pen.beginPath();
      some.forEach(([t, y]) => pen.lineTo(atX(t), atY(y)));
      pen.setLineDash(dash);
      pen.strokeStyle = colour(name);
      pen.lineWidth = thick;
      pen.stroke();
    };
    line([[0, 0], [run.end, 0]], "soft", 1, []);
    line(points, "faint", 1.5, []);
    if (dashed.length) line(dashed, "soft", 1.2, [5, 4]);
    pen.save();
    pen.beginPath();
    pen.rect(0, 0, atX(now), high);
    pen.clip();
    line(points, "data", 1.8, []);
    pen.restore();
    pen.fillStyle = colour("soft");
    pen.font = "12px system-ui, sans-serif";
    pen.fillText(digits(most), 1, 11);
    pen.fillText("0", 1, high - 4);
    pen.textAlign = "right";
    pen.fillText("t = " + timeText(run.end), wide - 1, high - 4);
  }

  // --- time passes

  const play = part("play"), scrub = part("time"), speed = part("speed");

  function show() {
    const state = fly(now);
    drawBox(state);
    showNumbers(state);
    for (const canvas of section.querySelectorAll(".brownpipe-replay-curve")) {
      drawCurve(canvas, curves[canvas.dataset.curve], canvas.dataset.curve === "energy" ? bath : []);
    }
    scrub.value = Math.round((1000 * now) / run.end);
    scrub.setAttribute("aria-valuetext", "t = " + timeText(now));
    play.textContent = playing ? "Pause" : "Play";
  }

  function go(time) {
    now = Math.min(run.end, Math.max(0, time));
    show();
  }

  function frame(clock) {
    if (!playing) return;
    now = Math.min(run.end, now + rate * Math.min(0.1, Math.max(0, clock - drawn) / 1000));
    drawn = clock;
    playing = now < run.end;
    show();
    requestAnimationFrame(frame);
  }

  function setPlaying(on) {
    if (on && now >= run.end) now = 0;
    if (on && !playing) requestAnimationFrame((clock) => { drawn = clock; frame(clock); });
    playing = on;
    show();
  }

  function setSpeed() {
    rate = (run.end / 30) * 2 ** Number(speed.value);  // by default the run takes 30 s
    part("rate").textContent = Number(rate.toPrecision(2)) + " time units per second";
    speed.setAttribute("aria-valuetext", part("rate").textContent);
    show();
  }

  if (isSmall) box.addEventListener("click", () => setPlaying(!playing));
  play.addEventListener("click", () => setPlaying(!playing));
  part("restart").addEventListener("click", () => go(0));
  scrub.addEventListener("input", () => go((run.end * Number(scrub.value)) / 1000));
  speed.addEventListener("input", setSpeed);
  section.addEventListener("keydown", (event) => {
    const on = event.target.tagName, back = now - run.end / 200, ahead = now + run.end / 200;
    const moves = {ArrowLeft: back, ArrowDown: back, ArrowRight: ahead, ArrowUp: ahead, Home: 0, End: run.end};
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key === " " && on !== "BUTTON") setPlaying(!playing);  // a button has the key already
    else if (event.key in moves && on !== "INPUT") go(moves[event.key]);  // so has a slider
    else return;
    event.preventDefault();
  });
  new ResizeObserver(() => requestAnimationFrame(show)).observe(part("panes"));  // later: `show` changes the size
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
  if (!isSmall && !window.matchMedia("(prefers-reduced-motion: reduce)").matches) {
    const watch = new IntersectionObserver(([seen]) => {
      if (!seen.isIntersecting) return;
      watch.disconnect();
      setPlaying(true);
    });
    watch.observe(box);
  }
  section.brownpipe = {end: run.end, at: (time) => inBox(fly(time).x), go, pixel: (x, y) => [toX(x), toY(y)]};
  setSpeed();
})();
