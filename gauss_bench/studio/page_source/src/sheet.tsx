// A dialog with a title, which closes with Esc, its cross or a click beside it, and which shows refusals.
import type { ComponentChildren, JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { Sign } from "./icons";
import { dialog, said } from "./state";
import { retold } from "./units";

export function Sheet({ title, children, wide }: { title: string; children: ComponentChildren; wide?: boolean }): JSX.Element {
  const ref = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    if (!ref.current!.open) ref.current!.showModal();
    if (said.value?.field !== "replace") said.value = null; // the dialog Save opens because of a refusal, which it must show
  }, []);
  return (
    <dialog
      ref={ref}
      class={wide ? "wide" : ""}
      aria-label={title}
      onClose={() => (dialog.value = "")}
      onClick={(e) => e.target === ref.current && ref.current!.close()}
    >
      <header>
        <h2>{title}</h2>
        <button type="button" class="icon" aria-label="Close" onClick={() => ref.current!.close()}>
          <Sign of="close" />
        </button>
      </header>
      {said.value?.level === "error" && (
        <p class="refusal" role="alert">
          {retold(said.value.text)}
        </p>
      )}
      <div class="inner" tabIndex={-1}>
        {children}
      </div>
    </dialog>
  );
}
