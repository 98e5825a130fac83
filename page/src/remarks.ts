/** What is said at the controls: a problem at the one that caused it, else a remark. */

import { element } from "./parts";

export class Remarks {
  private readonly places = new Map<string, HTMLElement>();

  /** Make the place below a control where its problems and remarks are told. */
  place(key: string): HTMLElement {
    const made = element("p", { id: `${key}-fault`, className: "fault", hidden: true });
    made.setAttribute("role", "alert");
    this.places.set(key, made);
    return made;
  }

  /** Put problems at the controls that caused them, and remarks where there is no problem; an empty key is no control's. */
  tell(problems: ReadonlyMap<string, string>, remarks: ReadonlyMap<string, string> = new Map()): void {
    for (const [key, element] of this.places) {
      const problem = problems.get(key) ?? "";
      const text = problem || (remarks.get(key) ?? "");
      if (element.textContent !== text) element.textContent = text;
      element.hidden = text === "";
      element.classList.toggle("remark", problem === "");
      const input = document.getElementById(`${key}-number`);
      if (problem) input?.setAttribute("aria-invalid", "true");
      else input?.removeAttribute("aria-invalid");
    }
  }

  knows(key: string): boolean {
    return this.places.has(key);
  }
}
