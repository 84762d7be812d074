async (count) => {
  const at = (query) => {
    const found = document.querySelector(query)?.getAttribute("transform") ?? "";
    return /translate\(([-\d.]+)[ ,]([-\d.]+)/.exec(found)?.slice(1).map(Number);
  };
  const frames = [];
  for (let n = 0; n < count; n++) {
    await new Promise(requestAnimationFrame);
    const pins = Object.fromEntries("ABCD".split("").map((name) => [name, at(`g.linkage [data-pin="${name}"]`)]));
    frames.push({ pins, BC: at(`[data-centre="crank,coupler"]`), pole: at(`[data-centre="ground,coupler"]`) });
  }
  return frames;
}
