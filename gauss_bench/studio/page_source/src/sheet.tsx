// What lies over the page: a dialog with a title, which ends with Esc, its cross, or a click beside it.
import type { ComponentChildren, JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { Sign } from "./icons";
import { dialog } from "./state";

export function Sheet({ title, children, wide }: { title: string; children: ComponentChildren; wide?: boolean }): JSX.Element {
  const ref = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    if (!ref.current!.open) ref.current!.showModal();
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
      <div class="inner" tabIndex={-1}>
        {children}
      </div>
    </dialog>
  );
}
