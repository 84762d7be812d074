// Records the motion as a film: the drawing area is painted frame by frame, and the browser records the frames.
import { batch } from "@preact/signals";
import { clock, moving, pace, playing, ready } from "./state";
import { size } from "./view";

const TYPE = "video/webm;codecs=vp8"; // every browser can play it
const [SHORTEST, LONGEST] = [1, 20]; // shortest and longest duration of a film [s]
const LINGER = 250; // [ms] wait between attempts to record the last picture
const [EMPTY, TRIES] = [400, 40]; // [bytes] size of a film without pictures; largest number of attempts to record one in a busy browser

export const canFilm = typeof MediaRecorder !== "undefined" && MediaRecorder.isTypeSupported(TYPE);

/** Returns the present drawing area as an image of `w` by `h` pixels; `looks` is the text of its style sheets. */
async function painted(looks: string, w: number, h: number): Promise<HTMLImageElement> {
  const copy = document.getElementById("canvas")!.cloneNode(true) as SVGSVGElement;
  for (const part of copy.querySelectorAll(".behind, .rubber")) part.remove();
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  copy.setAttribute("viewBox", `0 0 ${size.value[0]} ${size.value[1]}`);
  copy.setAttribute("data-theme", document.documentElement.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
  const style = document.createElementNS("http://www.w3.org/2000/svg", "style");
  style.textContent = `${looks}\n:root.canvas{width:${w}px;height:${h}px;font:14px system-ui,sans-serif}`;
  copy.prepend(style);
  const image = new Image(w, h);
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(new XMLSerializer().serializeToString(copy))}`;
  await image.decode();
  return image;
}

/** Plays the motion once at the chosen pace, and records it. */
export async function film(): Promise<Blob> {
  const motion = await ready();
  const end = motion?.times.at(-1) ?? 0;
  if (!motion || end <= 0) throw new Error("There is no motion to film: drive something first.");
  const [w, h] = size.value.map((n) => 2 * Math.floor(n / 2)) as [number, number];
  const canvas = Object.assign(document.createElement("canvas"), { width: w, height: h });
  const pen = canvas.getContext("2d")!;
  const looks = [...document.styleSheets].flatMap((sheet) => [...sheet.cssRules].map((rule) => rule.cssText)).join("\n");
  const paper = getComputedStyle(document.querySelector("main")!).backgroundColor;
  const paint = async (): Promise<void> => {
    await new Promise(requestAnimationFrame); // wait until the page has drawn the pose at the time `clock`
    const image = await painted(looks, w, h);
    pen.fillStyle = paper;
    pen.fillRect(0, 0, w, h);
    pen.drawImage(image, 0, 0, w, h);
  };
  const before = { clock: clock.value, moving: moving.value };
  const parts: Blob[] = [];
  const recorder = new MediaRecorder(canvas.captureStream(30), { mimeType: TYPE, videoBitsPerSecond: 4e6 });
  recorder.ondataavailable = (e) => parts.push(e.data);
  const over = new Promise((done) => (recorder.onstop = done));
  const seconds = Math.min(Math.max(end / pace.value, SHORTEST), LONGEST);
  batch(() => {
    playing.value = false;
    moving.value = true;
    clock.value = 0;
  });
  recorder.start();
  await paint();
  const began = performance.now();
  for (let share = 0; share < 1; ) {
    share = Math.min((performance.now() - began) / 1000 / seconds, 1);
    clock.value = share * end;
    await paint();
  }
  const recorded = (): number => parts.reduce((sum, part) => sum + part.size, 0);
  for (let tries = 0; tries < TRIES && recorded() < EMPTY; tries++) {
    await new Promise((done) => setTimeout(done, LINGER)); // the browser records a painted picture with a delay
    recorder.requestData();
    await paint();
  }
  recorder.stop();
  await over;
  batch(() => {
    clock.value = before.clock;
    moving.value = before.moving;
  });
  if (recorded() < EMPTY) throw new Error("The browser recorded nothing of it: take the animation as GIF.");
  return new Blob(parts, { type: "video/webm" });
}
