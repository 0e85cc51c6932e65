"use strict";

const root = document.documentElement;
root.classList.add("scripted");

function toggle(button) {
  const on = button.getAttribute("aria-pressed") !== "true";
  button.setAttribute("aria-pressed", on);
  return on;
}

// The theme is the system's until the reader says otherwise.
const theme = document.querySelector(".theme");
const system = matchMedia("(prefers-color-scheme: dark)");
const followSystem = () => root.dataset.theme || theme.setAttribute("aria-pressed", system.matches);
theme.addEventListener("click", () => { root.dataset.theme = toggle(theme) ? "dark" : "light"; });
system.addEventListener("change", followSystem);
followSystem();

const SCALES = { linear: (value) => value, log: Math.log };

// Where on an axis a value lies: 0 at its first limit, 1 at its second.
function along({ limits, scale, knots }) {
  if (knots) return between(knots);
  const [from, to] = limits.map(SCALES[scale]);
  return (value) => (SCALES[scale](value) - from) / (to - from);
}

// The same by values that lie at equal distances, in rising or falling order.
function between(knots) {
  const last = knots.length - 1, sign = Math.sign(knots[last] - knots[0]);
  return (value) => {
    let i = 1;
    while (i < last && sign * (knots[i] - value) < 0) i++;
    return (i - 1 + (value - knots[i - 1]) / (knots[i] - knots[i - 1])) / last;
  };
}

function words(value) {
  if (value === null) return "—";
  const size = Math.abs(value);
  const digits = Number.isInteger(value) ? {} : size >= 1e4 ? { maximumFractionDigits: 0 }
    : { minimumSignificantDigits: 4, maximumSignificantDigits: 4, notation: size < 1e-3 ? "scientific" : "standard" };
  return value.toLocaleString("en-US", digits).replaceAll("-", "−");
}

function csv({ names, panels }) {
  const cell = (value) => /[",\r\n]/.test(value) ? `"${value.replaceAll('"', '""')}"` : value;
  const lines = [["panel", "series", "x", "mean", "low", "high"]];
  panels.forEach(({ title, grids, series }, i) => series.forEach(({ name, x, mean, low, high }) => mean.forEach((y, k) =>
    lines.push([title || i + 1, names[name], grids[x][k], y, low?.[k], high?.[k]]))));
  return lines.map((line) => line.map((value) => cell(`${value ?? ""}`)).join(",") + "\r\n").join("");
}

function enliven(figure) {
  const data = JSON.parse(figure.querySelector("script").textContent);
  const buttons = [...figure.querySelectorAll(".legend button")];
  const tip = figure.querySelector(".tip");
  const isShown = ({ name }) => buttons[name].getAttribute("aria-pressed") === "true";

  buttons.forEach((button, name) => button.addEventListener("click", () => {
    const on = toggle(button);
    for (const mark of figure.querySelectorAll(`[data-series="${name}"]`)) mark.classList.toggle("off", !on);
  }));
  const runs = figure.querySelector(".runs");
  runs?.addEventListener("click", () => figure.classList.toggle("with-runs", toggle(runs)));
  figure.querySelector(".download").addEventListener("click", ({ currentTarget: download }) => {
    download.href = URL.createObjectURL(new Blob([csv(data)], { type: "text/csv" }));
    setTimeout(() => URL.revokeObjectURL(download.href), 10000);
  });

  for (const panel of data.panels) {
    if (panel.series.length) explore(panel);
  }

  function explore({ id, title, x, y, box, grids, series }) {
    const [left, top, width, height] = box;
    const axes = document.getElementById(id);
    const draw = (parent, tag, attributes) => {
      const element = document.createElementNS(axes.namespaceURI, tag);
      for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
      return parent.appendChild(element);
    };
    const across = along(x), up = along(y);
    const nearest = (values, share) => values.reduce((best, value, i) =>
      Math.abs(across(value) - share) < Math.abs(across(values[best]) - share) ? i : best, 0);
    const stops = () => [...new Set(series.filter(isShown).flatMap((one) => grids[one.x]))]
      .filter((stop) => across(stop) > -1e-6 && across(stop) < 1 + 1e-6).sort((a, b) => across(a) - across(b));
    const place = (value) => x.ticks.find(([tick]) => tick === value)?.[1] ??
      value.toLocaleString("en-US", { maximumSignificantDigits: 12 }).replaceAll("-", "−");
    const guide = draw(axes, "g", { class: "guide" });
    const hit = draw(axes, "rect", { class: "hit", x: left, y: top, width, height, tabindex: 0, role: "slider",
      "aria-label": `${title} values by ${x.label || "x"}`, "aria-valuemin": 0, "aria-valuenow": 0, "aria-valuetext": "none chosen" });
    let current = null;

    const hide = () => {
      tip.hidden ||= guide.hasChildNodes();
      guide.replaceChildren();
    };

    function show(share) {
      const among = stops();
      if (!among.length) return hide();
      const index = nearest(among, share);
      current = among[index];
      guide.replaceChildren();
      const middle = left + width * across(current);
      draw(guide, "path", { d: `M${middle} ${top}v${height}` });
      const table = document.createElement("table");
      table.createCaption().textContent = `${x.label || "x"}: ${place(current)}`;
      for (const one of series.filter(isShown)) {
        const grid = grids[one.x];
        const i = grid.length ? nearest(grid, across(current)) : 0;
        const [at, mean] = [grid[i] ?? current, one.mean[i]];
        const row = table.insertRow();
        const dot = draw(row.insertCell(), "svg", { viewBox: "0 0 10 10" });
        draw(dot, "circle", { cx: 5, cy: 5, r: 5, fill: one.color });
        dot.after(data.names[one.name] + (at === current ? "" : ` at ${place(at)}`));
        row.insertCell().textContent = words(mean);
        row.insertCell().textContent = one.low?.[i] == null ? "" : `[${words(one.low[i])}, ${words(one.high[i])}]`;
        if (mean !== null && up(mean) >= 0 && up(mean) <= 1) {
          draw(guide, "circle", { cx: left + width * across(at), cy: top + height * (1 - up(mean)), r: 3, fill: one.color });
        }
      }
      tip.replaceChildren(table);
      tip.hidden = false;
      placeTip(across(current));
      hit.setAttribute("aria-valuemax", among.length - 1);
      hit.setAttribute("aria-valuenow", index);
      hit.setAttribute("aria-valuetext", [table.caption, ...table.rows].map((part) => part.innerText).join("; "));
    }

    // Beside the guide where there is room, else below the panel.
    function placeTip(share) {
      const [outer, inner, all] = [figure, hit, axes.closest("svg")].map((each) => each.getBoundingClientRect());
      const middle = inner.left - outer.left + share * inner.width;
      const room = outer.width - tip.offsetWidth;
      const beside = middle <= room - 14 ? middle + 14 : middle - 14 - tip.offsetWidth;
      tip.style.left = `${Math.max(0, Math.min(room, beside >= 0 ? beside : middle - tip.offsetWidth / 2))}px`;
      tip.style.top = `${(beside >= 0 ? inner.top + 8 : all.bottom) - outer.top}px`;
    }

    for (const touch of ["pointermove", "pointerdown"]) hit.addEventListener(touch, ({ clientX }) => {
      const inner = hit.getBoundingClientRect();
      show((clientX - inner.left) / inner.width);
    });
    hit.addEventListener("pointerleave", (event) => event.pointerType === "mouse" && hide());
    document.addEventListener("pointerdown", (event) => event.target === hit || hide(), { capture: true });
    hit.addEventListener("focus", () => hit.matches(":focus-visible") && show(current === null ? 0.5 : across(current)));
    hit.addEventListener("blur", hide);
    hit.addEventListener("keydown", (event) => {
      const among = stops();
      const i = among.indexOf(current);
      const to = { ArrowLeft: i - 1, ArrowDown: i - 1, ArrowRight: i + 1, ArrowUp: i + 1, Home: 0, End: among.length - 1 }[event.key];
      if (event.key === "Escape") hide();
      if (to === undefined) return;
      event.preventDefault();
      if (among[to] !== undefined) show(across(among[to]));
    });
  }
}

for (const figure of document.querySelectorAll("figure:has(.legend)")) enliven(figure);
