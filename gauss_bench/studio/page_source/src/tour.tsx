// The tour at the first start: five steps, each beside the part of the page that it explains. It is shown only once.
import type { JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { anew, edit, touring } from "./state";
import { choose } from "./tools";

const SEEN = "studio.tour";
const STEPS: { title: string; text: string; at: string; do?: () => unknown }[] = [
  { title: "Draw", text: "Take a tool and click in the drawing. A bar that starts on a pin is joined to it; Ground pivot fixes a pin.", at: ".tools", do: () => choose("bar") },
  { title: "See what it is", text: "The page counts degrees of freedom and independent loops as you draw. It explains problems beside the parts and on the right.", at: ".top" },
  { title: "Move it", text: "Choose Select and drag any joint: the linkage follows and stays on its branch.", at: ".canvas", do: () => choose("select") },
  { title: "Play it", text: "Choose what is driven and press Play. Observed points draw their paths; curves of speed, acceleration and torque are below.", at: ".timeline" },
  { title: "Hand it on", text: "Save writes a linkage file, which every command of the suite reads. Release runs engines side by side. Share makes a link.", at: ".top .group" },
];

export function firstRun(): void {
  if (!localStorage.getItem(SEEN)) touring.value = 0;
}

function leave(): void {
  localStorage.setItem(SEEN, "seen");
  touring.value = -1;
}

export function Tour(): JSX.Element | null {
  const ref = useRef<HTMLDivElement>(null);
  const step = STEPS[touring.value];
  useEffect(() => {
    document.querySelectorAll(".toured").forEach((e) => e.classList.remove("toured"));
    if (!step) return;
    document.querySelector(step.at)?.classList.add("toured");
    ref.current?.querySelector<HTMLButtonElement>(".strong")?.focus();
    return () => document.querySelectorAll(".toured").forEach((e) => e.classList.remove("toured"));
  }, [touring.value]);
  if (!step) return null;
  const last = touring.value === STEPS.length - 1;
  return (
    <div ref={ref} class={`tour step-${touring.value}`} role="dialog" aria-label={`Tour, step ${touring.value + 1} of ${STEPS.length}`} onKeyDown={(e) => e.key === "Escape" && leave()}>
      <h2>{step.title}</h2>
      <p>{step.text}</p>
      <div class="row">
        <span class="dots" aria-hidden="true">
          {STEPS.map((_, i) => (
            <i key={i} class={i === touring.value ? "here" : ""} />
          ))}
        </span>
        <button type="button" class="quiet" onClick={leave}>
          Skip
        </button>
        <button
          type="button"
          class="strong"
          onClick={() => {
            if (last) return leave();
            touring.value += 1;
            STEPS[touring.value]!.do?.();
          }}
        >
          {last ? "Start drawing" : "Next"}
        </button>
      </div>
    </div>
  );
}

/** Opens a template from an empty drawing. */
export async function begin(name: string): Promise<void> {
  if (await edit("template", { name })) anew();
}
