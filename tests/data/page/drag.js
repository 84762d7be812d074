async ([from, centre, moves]) => {
  const canvas = document.getElementById("canvas");
  const send = (kind, [clientX, clientY], buttons) => {
    const what = { bubbles: true, clientX, clientY, buttons, button: 0, pointerId: 1, pointerType: "mouse" };
    canvas.dispatchEvent(new PointerEvent(kind, what));
  };
  const at = (share) => {
    const turn = 2 * Math.PI * share, [x, y] = [from[0] - centre[0], from[1] - centre[1]];
    return [centre[0] + x * Math.cos(turn) + y * Math.sin(turn), centre[1] + y * Math.cos(turn) - x * Math.sin(turn)];
  };
  const frame = async (k) => {
    for (let n = 0; Number(canvas.dataset.frames) !== k; n++) {
      if (n > 2000) throw new Error(`frame ${k} does not come`);
      await new Promise((done) => setTimeout(done, 4));
    }
  };
  canvas.setPointerCapture = () => {}; // of a pointer that is no real one
  send("pointermove", from, 0);
  send("pointerdown", from, 1);
  send("pointermove", at(0.05), 1); // further than a click may slip
  await frame(1);
  for (let k = 1; k <= moves; k++) {
    send("pointermove", at(k / moves), 1);
    await frame(k + 1);
  }
  send("pointerup", from, 0);
  delete canvas.setPointerCapture;
  return { frames: Number(canvas.dataset.frames), jump: Number(canvas.dataset.jump), solving: Number(canvas.dataset.ms) / 1000 };
}
