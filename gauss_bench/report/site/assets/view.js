"use strict";
// Draws the linkage that the address contains. Anybody can write an address, so every value is checked against LIMITS before it is
// used, and texts are only set as text. At the first wrong value the page shows one sentence and no drawing.
(() => {
  const LIMITS = /*limits*/;
  const SVG = "http://www.w3.org/2000/svg";
  const $ = (id) => document.getElementById(id);
  class Refused extends Error {}
  const refuse = (why) => { throw new Refused(`This link cannot be shown: ${why}.`); };

  // Reading: each function returns a checked value, or refuses the link
  const number = (x) => (typeof x === "number" && Math.abs(x) <= LIMITS.number ? x : refuse("it has a number that is missing or too large"));
  const list = (x, most) => (Array.isArray(x) && x.length <= most ? x : refuse("it has a list that is missing or too long"));
  const text = (x, most) => (typeof x === "string" && x.length <= most ? x : refuse("it has a text that is missing or too long"));
  const index = (x, least, count) => (Number.isInteger(x) && x >= least && x < count ? x : refuse("it names a link or point that it does not have"));
  const table = (x) => (typeof x === "object" && x !== null && !Array.isArray(x) ? x : refuse("it has no linkage"));

  /** Returns the object in the address; unpacking stops as soon as there are more bytes than LIMITS allow. */
  async function unpack(fragment) {
    if (fragment.length > LIMITS.fragment) refuse(`it has more than ${LIMITS.fragment} characters`);
    if (!/^v[0-9]+\.[A-Za-z0-9_-]+$/.test(fragment)) refuse("it has no linkage, or was changed on its way");
    if (!fragment.startsWith(LIMITS.version)) refuse("it was made for another edition of this page");
    if (typeof DecompressionStream === "undefined") refuse("this browser is too old to unpack it");
    const parts = [];
    let size = 0, content; // bytes so far
    try {
      const packed = Uint8Array.from(atob(fragment.slice(LIMITS.version.length).replace(/-/g, "+").replace(/_/g, "/")), (c) => c.charCodeAt(0));
      const reader = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate")).getReader();
      for (let next = await reader.read(); !next.done; next = await reader.read()) {
        size += next.value.length;
        if (size > LIMITS.unpacked) {
          reader.cancel().catch(() => undefined);
          refuse("it unpacks to more than a linkage needs");
        }
        parts.push(next.value);
      }
      content = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(await new Blob(parts).arrayBuffer()));
    } catch (error) {
      if (error instanceof Refused) throw error;
      refuse("it is cut off, or was changed on its way");
    }
    return table(content);
  }

  /** Returns whole numbers from their second differences. */
  function integrate(differences) {
    let step = 0, sum = 0;
    return differences.map((x) => {
      step += number(x);
      sum += step;
      return Number.isInteger(x) ? number(sum) : refuse("a pose is not in whole numbers");
    });
  }

  /** Returns the linkage, made of checked values alone. */
  function check(given) {
    let places = 0;
    const counted = (x) => { // a list whose entries count as places
      places += list(x, LIMITS.places).length;
      return places <= LIMITS.places ? x : refuse("it has too many points");
    };
    const links = list(given.links, LIMITS.links).map((entry) => {
      const link = table(entry);
      const points = counted(link.points).map((p) => list(p, 2) && [number(p[0]), number(p[1])]);
      const bars = counted(link.bars).map((b) => list(b, 2) && [points[index(b[0], 0, points.length)], points[index(b[1], 0, points.length)]]);
      return { name: text(link.name, LIMITS.name), points, bars, crank: link.crank === true };
    });
    const place = (x) => ({ link: index(list(x, 3)[0], -1, links.length), at: [number(x[1]), number(x[2])] });
    const slides = counted(given.slides).map((x) => {
      const [guide, gx, gy, angle, block, bx, by] = list(x, 7);
      return { guide: index(guide, -1, links.length), from: [number(gx), number(gy)], angle: number(angle), block: place([block, bx, by]) };
    });
    const ties = counted(given.ties).map((x) => [place(list(x, 6).slice(0, 3)), place(x.slice(3))]);
    const unit = number(given.unit);
    const series = list(given.poses, 3 * LIMITS.links).map((x) => integrate(list(x, LIMITS.poses)));
    const count = series.length ? series[0].length : 0;
    if (!links.length || series.length !== 3 * links.length || !count || series.some((x) => x.length !== count)) refuse("it does not have poses for every link");
    const pose = (k) => links.map((_, i) => [series[3 * i][k] * unit, series[3 * i + 1][k] * unit, series[3 * i + 2][k] / LIMITS.angles]);
    return {
      name: text(given.name, LIMITS.name), title: text(given.title, LIMITS.unpacked), scenario: text(given.scenario, LIMITS.name),
      file: text(given.file, LIMITS.unpacked), links, slides, ties, pins: counted(given.pins).map(place), paths: counted(given.paths).map(place),
      end: Math.max(number(given.end), 0), poses: Array.from({ length: count }, (_, k) => pose(k)),
    };
  }

  // Drawing
  // Returns the position in the world of a place in the frame of a link.
  const toWorld = ([x, y, turn], [a, b]) => [x + Math.cos(turn) * a - Math.sin(turn) * b, y + Math.sin(turn) * a + Math.cos(turn) * b];
  const positionOf = (pose, { link, at }) => (link < 0 ? at : toWorld(pose[link], at)); // -1 is the ground
  const pathData = (points, end = "") => points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("") + end;

  /** Returns the corners of the convex hull of points (Andrew's monotone chain). */
  function hull(points) {
    const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const half = (chain) => chain.reduce((out, p) => {
      while (out.length > 1 && (out.at(-1)[0] - out.at(-2)[0]) * (p[1] - out.at(-2)[1]) <= (out.at(-1)[1] - out.at(-2)[1]) * (p[0] - out.at(-2)[0])) out.pop();
      return [...out, p];
    }, []).slice(0, -1);
    return [...half(sorted), ...half(sorted.reverse())];
  }

  /** Adds an SVG element with a CSS class and attributes to `parent`, and returns it. */
  function make(kind, css, parent, attributes = {}) {
    const part = document.createElementNS(SVG, kind);
    part.setAttribute("class", css);
    for (const [key, value] of Object.entries(attributes)) part.setAttribute(key, value);
    parent.append(part);
    return part;
  }

  /** Draws everything once, and returns a function that moves everything to the pose of a given index. */
  function stage(linkage, width) {
    const { links, slides, ties, pins, paths, poses } = linkage;
    const all = [...pins, ...paths, ...slides.map((x) => x.block), ...ties.flat(), ...links.flatMap((x, link) => x.points.map((at) => ({ link, at })))];
    const ends = [Infinity, -Infinity, Infinity, -Infinity]; // least and largest x, least and largest y [m]
    for (const pose of poses) {
      for (const [x, y] of all.map((p) => positionOf(pose, p))) {
        ends.splice(0, 4, Math.min(ends[0], x), Math.max(ends[1], x), Math.min(ends[2], y), Math.max(ends[3], y));
      }
    }
    if (!ends.every(Number.isFinite)) refuse("it has no point");
    const [w, h] = [Math.max(ends[1] - ends[0], 1e-9), Math.max(ends[3] - ends[2], 1e-9)], margin = 34;
    const scale = Math.min((width - 2 * margin) / w, (Math.max(260, 0.7 * width) - 2 * margin) / h);
    const height = Math.max(h * scale + 2 * margin, 160);
    const view = ([x, y]) => [width / 2 + (x - (ends[0] + ends[1]) / 2) * scale, height / 2 - (y - (ends[2] + ends[3]) / 2) * scale];
    const inFrame = ([x, y]) => [x * scale, -y * scale]; // pixels in the frame of a link
    const svg = make("svg", "", document.createDocumentFragment(), { viewBox: `0 0 ${width.toFixed(0)} ${height.toFixed(0)}`, role: "img" });
    svg.setAttribute("aria-label", `${linkage.name}: ${links.length} links`);
    const degrees = (turn) => ((-turn * 180) / Math.PI).toFixed(3);
    const moves = []; // for each part a function that moves it to a pose

    for (const { link, at } of pins.filter((x) => x.link < 0)) {
      const [x, y] = view(at);
      make("path", "ground", svg, { d: `M${x} ${y}l-10 17h20zM${x - 16} ${y + 17}h32` });
    }
    for (const slide of slides) {
      const length = Math.max(60, 0.1 * width);
      const part = make("g", "", svg);
      make("path", "rail", part, { d: `M${-length} 11H${length}M${-length} -11H${length}` });
      make("rect", "block", part, { x: -15, y: -9, width: 30, height: 18, rx: 3 });
      moves.push((pose) => {
        const [x, y] = view(positionOf(pose, slide.block));
        const turn = slide.angle + (slide.guide < 0 ? 0 : pose[slide.guide][2]);
        part.setAttribute("transform", `translate(${x.toFixed(2)} ${y.toFixed(2)}) rotate(${degrees(turn)})`);
      });
    }
    links.forEach((link, i) => {
      const part = make("g", link.crank ? "crank" : "link", svg);
      const points = link.points.map(inFrame);
      const bars = link.bars.length ? link.bars.map((bar) => pathData(bar.map(inFrame))).join("") : points.length === 2 ? pathData(points) : "";
      if (points.length > 2) make("path", "plate", part, { d: pathData(hull(points), "Z") });
      if (bars) for (const css of ["edge", "fill"]) make("path", css, part, { d: bars });
      make("title", "", part).textContent = link.name;
      moves.push((pose) => {
        const [x, y] = view(pose[i]);
        part.setAttribute("transform", `translate(${x.toFixed(2)} ${y.toFixed(2)}) rotate(${degrees(pose[i][2])})`);
      });
    });
    for (const [a, b] of ties) {
      const tie = make("path", "tie", svg);
      moves.push((pose) => tie.setAttribute("d", pathData([view(positionOf(pose, a)), view(positionOf(pose, b))])));
    }
    for (const point of paths) {
      if (poses.length > 1) make("path", "path", svg, { d: pathData(poses.map((pose) => view(positionOf(pose, point)))) });
      follow(point, "eye", 4);
    }
    for (const pin of pins) follow(pin, "pin", 4.6);

    function follow(point, css, r) {
      const dot = make("circle", css, svg, { r });
      moves.push((pose) => {
        const [x, y] = view(positionOf(pose, point));
        dot.setAttribute("cx", x.toFixed(2));
        dot.setAttribute("cy", y.toFixed(2));
      });
    }
    $("stage").replaceChildren(svg);
    return (k) => moves.forEach((move) => move(poses[k]));
  }

  // Playing
  let now = null; // the shown linkage, its function `draw`, and the index k of its pose
  let since = null; // [ms] time at which the motion was at its first pose; null if it does not play
  const step = () => (now.linkage.poses.length > 1 ? now.linkage.end / (now.linkage.poses.length - 1) : 0); // seconds between poses

  function show(k) {
    const { poses, end } = now.linkage;
    now.k = Math.min(Math.max(k, 0), poses.length - 1);
    now.draw(now.k);
    $("at").value = String(now.k);
    $("time").textContent = poses.length > 1 ? `${(now.k * step()).toPrecision(3)} s of ${end.toPrecision(3)} s` : "one pose";
  }
  function play(on) {
    since = on && step() > 0 ? performance.now() - (now.k * step() * 1000) / $("pace").value : null;
    $("play").textContent = since === null ? "Play" : "Pause";
    if (since !== null) requestAnimationFrame(frame);
  }
  function frame(t) {
    if (since === null || !now) return;
    const passed = (Math.max(t - since, 0) / 1000) * $("pace").value;
    show(Math.floor((passed % (now.linkage.end + step())) / step())); // the last pose stays as long as the others
    requestAnimationFrame(frame);
  }
  function move(by) {
    play(false);
    const count = now.linkage.poses.length;
    show((now.k + by + count) % count);
  }

  async function open() {
    const fragment = location.hash.slice(1);
    since = now = null;
    $("shown").hidden = true;
    $("stage").replaceChildren();
    $("file").textContent = $("copied").textContent = "";
    $("name").textContent = "A linkage in its address";
    document.title = "A linkage in its address · gauss_bench";
    if (!fragment) {
      $("lead").textContent = "This page draws the linkage that its address has after the # sign. This address has none.";
      return;
    }
    try {
      const linkage = check(await unpack(fragment));
      if (fragment !== location.hash.slice(1)) return; // another address was opened meanwhile
      $("shown").hidden = false; // a hidden stage has no width
      now = { linkage, draw: stage(linkage, Math.max($("stage").clientWidth, 280)), k: 0 };
      $("name").textContent = linkage.name || "A linkage";
      document.title = `${linkage.name} · gauss_bench`;
      $("lead").textContent = linkage.title;
      $("file").textContent = linkage.file;
      const count = linkage.poses.length;
      $("origin").textContent = count > 1 ? `${count} samples of the scenario ${linkage.scenario}` : "the one pose of the drawing";
      $("at").max = String(count - 1);
      document.querySelector(".controls").hidden = count < 2;
      show(0);
      play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
    } catch (error) {
      now = null;
      $("shown").hidden = true;
      $("stage").replaceChildren();
      $("lead").textContent = error instanceof Refused ? error.message : "This link cannot be shown.";
    }
  }

  $("play").addEventListener("click", () => play(since === null));
  $("back").addEventListener("click", () => move(-1));
  $("on").addEventListener("click", () => move(1));
  $("pace").addEventListener("change", () => play(since !== null));
  $("at").addEventListener("input", () => { play(false); show(Number($("at").value)); });
  let pressed = null;
  $("stage").addEventListener("pointerdown", (e) => { pressed = [e.clientX, e.clientY]; });
  $("stage").addEventListener("pointerup", (e) => {
    if (!now || !pressed || now.linkage.poses.length < 2) return;
    const [dx, dy] = [e.clientX - pressed[0], e.clientY - pressed[1]];
    pressed = null;
    if (Math.abs(dx) > 24 && Math.abs(dx) > Math.abs(dy)) move(dx > 0 ? 1 : -1);
    else if (Math.hypot(dx, dy) < 10) play(since === null);
  });
  addEventListener("keydown", (e) => {
    if (!now || now.linkage.poses.length < 2 || e.ctrlKey || e.metaKey || e.altKey || e.target.closest("select, pre, summary, input")) return;
    if (e.key === " " && e.target.closest("button")) return; // the browser itself presses the button
    const go = { " ": () => play(since === null), ArrowLeft: () => move(-1), ArrowRight: () => move(1), Home: () => move(-now.k), End: () => move(-now.k - 1) }[e.key];
    if (!go) return;
    e.preventDefault();
    go();
  });
  $("copy").addEventListener("click", async () => {
    const done = navigator.clipboard ? await navigator.clipboard.writeText(now.linkage.file).then(() => true, () => false) : false;
    if (!done) getSelection().selectAllChildren($("file"));
    $("copied").textContent = done ? "Copied." : "Selected: copy it by the keys or the menu of the browser.";
  });
  let resizing = 0;
  addEventListener("resize", () => {
    cancelAnimationFrame(resizing);
    resizing = requestAnimationFrame(() => {
      if (!now) return;
      now.draw = stage(now.linkage, Math.max($("stage").clientWidth, 280));
      show(now.k);
    });
  });
  addEventListener("hashchange", () => void open());
  void open();
})();
