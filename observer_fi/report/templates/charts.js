/* Charts of a page: unpacks what report/interactive.py wrote, has uPlot draw it, links axes, zooms, hides, prints.

One Axis a link: all panels that share the range of x, wherever on the page they stand. One Chart a panel. */
"use strict";
(function () {
  const FONT = "12px system-ui, -apple-system, 'Segoe UI', Roboto, Arial, sans-serif";
  const PART = "Part of the log that is shown";
  const HOW = "Drag across a chart to zoom, double-click to see all of it again. With a chart chosen: arrows move, + and \u2212 " +
    "or the wheel zoom, 0 shows all. Fingers move and pinch. A line's name hides it.";
  const axes = new Map(), all = [], PAPER = 700; // CSS pixels of a chart in print
  const WHOLE = [0, 1, 2, 3, 4, 5, 6].flatMap(k => [1, 2, 5].map(v => v * 10 ** k)); // steps between whole numbers

  // --- data ---

  function unpacked(packed) {
    if (Array.isArray(packed)) return packed;
    const text = atob(packed.data), bytes = new Uint8Array(text.length);
    for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
    const raw = new { f8: Float64Array, f4: Float32Array, u2: Uint16Array }[packed.kind](bytes.buffer); // little-endian, as all are
    if (packed.kind !== "u2") return Array.from(raw, v => Number.isFinite(v) ? v : null);
    const step = (packed.high - packed.low) / 65534;
    return Array.from(raw, v => v > 65534 ? null : packed.low + v * step);
  }

  function digits(value, count) { // significant ones, without an e
    const rounded = +value.toPrecision(count), short = v => v.replace("-", "\u2212");
    if (!rounded || (Math.abs(rounded) >= 1e-4 && Math.abs(rounded) < 1e6)) return short(String(rounded));
    const [mantissa, power] = value.toExponential(count - 1).split("e");
    return short(String(+mantissa)) + "\u00a0\u00d7\u00a010" + [...power.replace("+", "")].map(c => "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"[c] || "\u207b").join("");
  }

  function shown(value, unit) {
    if (value == null) return "";
    return digits(value, 4) + (unit ? "\u00a0" + unit : "");
  }

  function graded(value, step) { // a place on an axis, with the digits that tell it from the next one
    if (!step || Math.abs(value) >= 1e5 || step < 1e-6) return digits(value, 3);
    let places = 0;
    while (places < 7 && Math.abs(step * 10 ** places - Math.round(step * 10 ** places)) > 1e-6) places++;
    return value.toFixed(places).replace("-", "\u2212");
  }

  function known(y, k, spans) { // the reading at k, or the nearest one of a line that goes on where points are missing
    for (let off = 0; spans && y[k] == null && off < y.length; off++) if (y[k - off] != null || y[k + off] != null) return y[k - off] ?? y[k + off];
    return y[k];
  }

  function decades(low, high, parts) { // some powers of ten and multiples of them, within positive limits
    const first = Math.floor(Math.log10(low)), last = Math.ceil(Math.log10(high)), found = [];
    const step = Math.max(1, Math.ceil((last - first) / 4));
    for (let k = first; k <= last; k += step) for (const part of parts) found.push(part * 10 ** k);
    return found.filter(v => v >= low && v <= high);
  }

  const gradations = { // where the lines of an axis that is not linear stand
    log: (low, high) => decades(low, high, high < 160 * low ? [1, 2, 5] : [1]),
    asinh: (low, high) => [...decades(10, -low, [1]).map(v => -v).reverse(), 0, ...decades(10, high, [1])],
  };

  // --- one axis for the panels of a link ---

  class Axis {
    constructor(key) {
      Object.assign(this, { key: key, charts: [], bars: [], whole: [Infinity, -Infinity], now: null, drawing: 0 });
    }
    cover(x, share) {
      if (!x.length) return;
      const low = x[0], high = x[x.length - 1], room = high > low ? share * (high - low) : 0.5;
      this.whole = [Math.min(this.whole[0], low - room), Math.max(this.whole[1], high + room)];
    }
    zoom(low, high) {
      const least = 1e-7 * (this.whole[1] - this.whole[0]);
      if (!(high - low > least)) return;
      const shift = Math.max(this.whole[0] - low, 0) - Math.max(high - this.whole[1], 0);
      low = Math.max(low + shift, this.whole[0]);
      high = Math.min(high + shift, this.whole[1]);
      this.now = [low, high];
      if (!this.drawing) this.drawing = requestAnimationFrame(() => this.draw());
    }
    draw() {
      cancelAnimationFrame(this.drawing);
      this.drawing = 0;
      this.now = this.now || this.whole;
      for (const chart of this.charts) if (chart.u) chart.u.setScale("x", { min: this.now[0], max: this.now[1] });
      for (const bar of this.bars) bar();
    }
    by(factor, around) {
      const [low, high] = this.now, at = around == null ? (low + high) / 2 : around;
      this.zoom(at - (at - low) * factor, at + (high - at) * factor);
    }
    pan(share) {
      const by = share * (this.now[1] - this.now[0]);
      this.zoom(this.now[0] + by, this.now[1] + by);
    }
    reset() { this.zoom(this.whole[0], this.whole[1]); }
  }

  function axisOf(key) {
    if (!axes.has(key)) axes.set(key, new Axis(key));
    return axes.get(key);
  }

  // --- one panel ---

  class Chart {
    constructor(group, spec, place, x, points, first, last) {
      Object.assign(this, { group, spec, place, first, last, u: null, x, on: spec.series.map(s => s.shown) });
      Object.assign(this, { plot: place.querySelector(".plot"), at: [] }); // at: of each series, its place among uPlot's
      this.points = points[spec.points];
      this.who = document.createElement("output");
      this.who.className = "who";
      if (this.points.names.length) place.querySelector(".head").append(this.who);
      this.axis = axisOf(spec.link || group.id + "-" + all.length);
      this.axis.cover(this.x, spec.series.some(s => s.points > 3) ? 0.02 : 0); // room for dots at the ends
      this.axis.charts.push(this);
      this.legend();
      this.keys();
      new ResizeObserver(() => this.fit()).observe(this.plot);
    }
    css(name) { return getComputedStyle(this.group).getPropertyValue(name).trim(); }
    colour(number) { return () => this.css("--c" + number); }
    legend() {
      this.values = this.spec.series.map((series, k) => {
        const [button, line, value] = ["button", "i", "output"].map(tag => document.createElement(tag));
        Object.assign(button, { type: "button", ariaPressed: String(series.shown) });
        line.className = series.width ? "" : "dots";
        line.style[series.width ? "borderTopColor" : "background"] = "var(--c" + series.colour + ")";
        if (series.dash.length) line.style.borderTopStyle = "dashed";
        button.append(line, series.name, value);
        button.addEventListener("click", () => {
          this.on[k] = !this.on[k];
          button.ariaPressed = String(this.on[k]);
          if (this.u) for (const at of this.at[k]) this.u.setSeries(at, { show: this.on[k] });
        });
        this.place.querySelector(".legend").append(button);
        return value;
      });
    }
    fit() {
      const width = document.documentElement.classList.contains("paper") ? PAPER : this.plot.clientWidth;
      if (width < 40) return; // folded
      if (!this.u) this.make(width);
      else if (Math.abs(this.u.width - width) >= 1) this.u.setSize({ width: width, height: this.spec.height });
    }
    series() {
      const found = [{}], data = [this.x], bands = [];
      this.spec.series.forEach((s, k) => {
        const stroke = this.colour(s.colour), own = [found.length];
        found.push({
          stroke: stroke, width: s.width || 1, dash: s.dash.length ? s.dash : undefined, show: this.on[k], spanGaps: s.spans,
          paths: s.width ? undefined : () => null,
          points: { show: s.points > 0, size: s.points, stroke: stroke, fill: stroke, width: 0 },
        });
        data.push(unpacked(s.y));
        if (s.low) {
          const at = found.length;
          for (const side of ["high", "low"]) {
            found.push({ stroke: () => "transparent", width: 0, show: this.on[k], spanGaps: s.spans, points: { show: false } });
            data.push(unpacked(s[side]));
          }
          bands.push({ series: [at, at + 1], fill: () => this.css("--c" + s.colour) + "38" });
          own.push(at, at + 1);
        }
        this.at.push(own);
      });
      return [found, data, bands];
    }
    range(low, high) {
      const { limits, least } = this.spec;
      if (limits) return limits;
      if (low == null || high == null) return [0, 1];
      for (const level of this.spec.levels) if (level.to == null) { low = Math.min(low, level.y); high = Math.max(high, level.y); }
      if (this.spec.scale === "log") return [low / 1.3, high * 1.3];
      if (this.spec.scale === "asinh") return [Math.min(1.5 * low, -1), Math.max(1.5 * high, 1)];
      const alone = high - low > 1e-9 * Math.abs(high) ? 0 : 0.1 * Math.abs(high) || 1e-12; // one value: something around it
      const room = Math.max(0.06 * (high - low), 0.5 * (least - (high - low)), alone);
      return [low - room, high + room];
    }
    make(width) {
      const [series, data, bands] = this.series(), spec = this.spec, ink = () => this.css("--muted");
      const line = { stroke: () => this.css("--line"), width: 1 };
      const last = this.last || !spec.link, y = { auto: true, range: (u, low, high) => this.range(low, high) };
      Object.assign(y, { log: { distr: 3 }, asinh: { distr: 4, asinh: 1 } }[spec.scale]);
      const across = { stroke: ink, font: FONT, labelFont: FONT, grid: line, ticks: line, size: last ? 28 : 6, gap: 4, space: 64 };
      if (this.points.names.length && this.x.every(Number.isInteger)) across.incrs = WHOLE;
      across.values = (u, at, k, space, step) => at.map(v => last && v != null ? graded(v, step) : "");
      if (last && spec.xName) Object.assign(across, { label: spec.xName, labelSize: 18, labelGap: 0 });
      if (spec.ticks.length) Object.assign(across, { splits: () => spec.ticks.map(t => t[0]), values: () => spec.ticks.map(t => t[1]), size: 44 });
      const up = { stroke: ink, font: FONT, grid: line, ticks: { ...line, size: 4 }, size: 58, gap: 4, space: 26 };
      const linear = !gradations[spec.scale];
      up.values = (u, at, k, space, step) => at.map(v => v == null ? "" : linear ? graded(v, step) : digits(v, 3));
      if (spec.ticksUp.length) Object.assign(up, { splits: () => spec.ticksUp.map(t => t[0]), values: () => spec.ticksUp.map(t => t[1]) });
      if (gradations[spec.scale]) Object.assign(up, { splits: (u, k, low, high) => gradations[spec.scale](low, high), filter: (u, at) => at });
      this.plot.style.height = "";
      this.u = new uPlot({
        width: width, height: spec.height + (last ? 40 : 0), series: series, bands: bands, legend: { show: false },
        padding: [(this.first && spec.link) || spec.marks.length ? 18 : 8, 10, 0, 0],
        cursor: {
          y: false, sync: { key: this.axis.key, setSeries: false, scales: ["x", null] }, focus: { prox: -1 },
          drag: { x: true, y: false, setScale: false }, points: { size: 7 },
          bind: { dblclick: () => () => { this.axis.reset(); return null; } },
        },
        scales: { x: { time: false, auto: false, range: (u, low, high) => [low, high] }, y: y },
        axes: [across, up],
        hooks: { drawClear: [() => this.behind()], draw: [() => this.moments()], setCursor: [() => this.read()], setSelect: [() => this.dragged()] },
      }, data, this.plot);
      spec.height = this.u.height;
      this.u.setScale("x", { min: this.axis.now[0], max: this.axis.now[1] });
      this.fingers();
    }

    // --- what uPlot does not draw ---

    box() { const b = this.u.bbox; return [b.left, b.top, b.width, b.height]; }
    marks() { return [...(this.spec.link ? this.group.marks : []), ...this.spec.marks]; }
    clipped(paint) {
      const ctx = this.u.ctx, box = new Path2D();
      box.rect(...this.box());
      ctx.save();
      ctx.clip(box);
      paint(ctx, this.u);
      ctx.restore();
    }
    behind() {
      this.clipped((ctx, u) => {
        const [left, top, width, height] = this.box();
        for (const level of this.spec.levels) if (level.to != null) {
          const a = u.valToPos(level.y, "y", true), b = u.valToPos(level.to, "y", true);
          ctx.fillStyle = this.css("--soft");
          ctx.fillRect(left, b, width, a - b);
        }
        for (const mark of this.marks()) if (mark.low != null) {
          const a = u.valToPos(mark.low, "x", true), b = u.valToPos(mark.high, "x", true);
          ctx.fillStyle = this.css("--c" + mark.colour) + "30";
          ctx.fillRect(a, top, Math.max(b - a, 2 * devicePixelRatio), height);
        }
      });
    }
    moments() {
      const dpr = devicePixelRatio, [left, top, width, height] = this.box(), u = this.u;
      const lines = this.marks().filter(mark => mark.at != null).map(mark => [u.valToPos(mark.at, "x", true), mark])
        .filter(([x]) => x >= left - 1 && x <= left + width + 1).sort((a, b) => a[0] - b[0]);
      this.clipped(ctx => {
        for (const level of this.spec.levels) if (level.to == null) {
          const y = u.valToPos(level.y, "y", true), above = y - 16 * dpr > top;
          this.line(ctx, left, y, left + width, y, this.css("--muted"), [4, 3]);
          this.word(ctx, level.name, left + 5 * dpr, y + (above ? -4 : 13) * dpr, this.css("--muted"));
        }
        for (const [x, mark] of lines) this.line(ctx, x, top, x, top + height, this.css("--c" + mark.colour), [5, 3]);
      });
      let free = left;
      for (const [x, mark] of lines) if (this.spec.marks.includes(mark) || (this.first && this.spec.link)) {
        const wide = this.word(u.ctx, mark.name, 0, 0, "transparent"), at = Math.max(Math.min(x - wide / 2, left + width - wide), free);
        if (at + wide > left + width + 1 || at - x > 40 * dpr) continue; // no room: its line and the text below tell it
        this.word(u.ctx, mark.name, at, top - 5 * dpr, this.css("--c" + mark.colour));
        free = at + wide + 8 * dpr;
      }
    }
    line(ctx, x0, y0, x1, y1, colour, dash) {
      Object.assign(ctx, { strokeStyle: colour, lineWidth: 1.2 * devicePixelRatio });
      ctx.setLineDash(dash.map(d => d * devicePixelRatio));
      ctx.stroke(new Path2D("M" + x0 + " " + y0 + "L" + x1 + " " + y1));
    }
    word(ctx, text, x, y, colour) { // writes it, and says how wide it is
      const font = FONT.replace("12px", 12 * devicePixelRatio + "px");
      ctx.save();
      Object.assign(ctx, { font: font, textAlign: "left", textBaseline: "alphabetic", fillStyle: colour });
      ctx.fillText(text, x, y);
      const { width } = ctx.measureText(text);
      ctx.restore();
      return width;
    }
    read() {
      const u = this.u, k = u ? u.cursor.idx : null, inside = k != null && u.cursor.left >= 0;
      this.values.forEach((value, s) => {
        value.textContent = inside && this.on[s] ? shown(known(u.data[this.at[s][0]], k, this.spec.series[s].spans), this.spec.unit) : "";
      });
      const when = this.group.querySelector(".when");
      if (when && this.spec.link) when.textContent = inside ? +this.x[k].toFixed(5) + " s" : "";
      this.who.textContent = inside ? this.points.names[k] || "" : "";
      if (u) u.over.style.cursor = this.leads() ? "pointer" : "";
    }
    leads() { // where a click leads: to what the dot under the cursor is of
      const { idx, left } = this.u.cursor, near = idx != null && Math.abs(this.u.valToPos(this.x[idx], "x") - left) < 12;
      return near ? this.points.links[idx] || "" : "";
    }

    // --- hands ---

    dragged() {
      const u = this.u, { left, width } = u.select;
      if (width) u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
      if (width > 4 && this.axis.held === this) this.axis.zoom(u.posToVal(left, "x"), u.posToVal(left + width, "x"));
    }
    keys() {
      this.plot.addEventListener("keydown", event => {
        const does = {
          ArrowLeft: () => this.axis.pan(-0.2), ArrowRight: () => this.axis.pan(0.2), "+": () => this.axis.by(0.5),
          "=": () => this.axis.by(0.5), "-": () => this.axis.by(2), 0: () => this.axis.reset(), Escape: () => this.axis.reset(),
        }[event.key];
        if (!does || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        does();
      });
      this.plot.addEventListener("wheel", event => {
        if (!this.u || !(event.ctrlKey || document.activeElement === this.plot)) return; // else the page scrolls
        event.preventDefault();
        this.axis.by(Math.exp(0.002 * Math.max(-200, Math.min(200, event.deltaY))), this.under(event.clientX));
      }, { passive: false });
    }
    under(clientX) { return this.u.posToVal(clientX - this.u.over.getBoundingClientRect().left, "x"); }
    fingers() {
      const down = new Map(), over = this.u.over;
      let pressed = 0;
      over.addEventListener("mousedown", event => { this.axis.held = this; pressed = event.clientX; });
      over.addEventListener("click", event => { if (Math.abs(event.clientX - pressed) < 4 && this.leads()) location.href = this.leads(); });
      over.addEventListener("pointerdown", event => {
        if (event.pointerType === "touch") { down.set(event.pointerId, event.clientX); over.setPointerCapture(event.pointerId); }
      });
      over.addEventListener("pointermove", event => {
        if (!down.has(event.pointerId)) return;
        const before = [...down.values()], width = over.clientWidth;
        down.set(event.pointerId, event.clientX);
        const after = [...down.values()];
        if (after.length === 1) this.axis.pan((before[0] - after[0]) / width);
        else if (after.length === 2) {
          const apart = Math.max(Math.abs(after[0] - after[1]), 10);
          this.axis.by(Math.max(Math.abs(before[0] - before[1]), 10) / apart, this.under((after[0] + after[1]) / 2));
        }
      });
      for (const end of ["pointerup", "pointercancel"]) over.addEventListener(end, event => down.delete(event.pointerId));
    }
  }

  // --- the buttons above a group ---

  function bar(group, spec, axis) {
    const [place, when, list] = ["div", "output", "select"].map(tag => document.createElement(tag)), [low, high] = axis.whole;
    const views = [{ name: "whole log", low: low, high: high }, ...spec.views].map(
      view => ({ name: view.name, low: Math.max(view.low, low), high: Math.min(view.high, high) }));
    const near = view => Math.abs(view.low - axis.now[0]) + Math.abs(view.high - axis.now[1]) < 1e-6 * (high - low);
    Object.assign(place, { className: "views", role: "group", ariaLabel: PART });
    when.className = "when";
    if (views.length > 9) {
      list.ariaLabel = PART;
      list.append(new Option("a part of your own", ""), ...views.map((view, k) => new Option(view.name, k)));
      list.addEventListener("change", () => list.value && axis.zoom(views[list.value].low, views[list.value].high));
      axis.bars.push(() => { const k = views.findIndex(near); list.value = k < 0 ? "" : k; });
      place.append(list);
    } else for (const view of views) {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: view.name });
      button.addEventListener("click", () => axis.zoom(view.low, view.high));
      axis.bars.push(() => { button.ariaPressed = String(near(view)); });
      place.append(button);
    }
    place.append(when);
    group.prepend(place);
    if (spec.start != null) axis.now = [views[spec.start + 1].low, views[spec.start + 1].high];
  }

  for (const group of document.querySelectorAll(".charts")) {
    const spec = JSON.parse(group.querySelector('script[type="application/json"]').textContent), xs = spec.x.map(unpacked);
    const places = group.querySelectorAll(".panel"), linked = spec.panels.filter(p => p.link);
    group.marks = spec.marks;
    spec.panels.forEach((panel, k) => {
      all.push(new Chart(group, panel, places[k], xs[panel.x], spec.points, panel === linked[0], panel === linked[linked.length - 1]));
    });
    if (spec.views.length) bar(group, spec, axes.get(linked[0].link));
  }
  const first = document.querySelector(".charts");
  if (first) first.append(Object.assign(document.createElement("p"), { className: "how", textContent: HOW }));
  for (const axis of axes.values()) axis.draw();

  function redraw() { for (const chart of all) { chart.fit(); if (chart.u) chart.u.redraw(false, true); } }
  function paper(on) { document.documentElement.classList.toggle("paper", on); redraw(); }
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  matchMedia("print").addEventListener("change", event => paper(event.matches));
  window.observerFiCharts = { axes: axes, charts: all }; // for tests
})();
