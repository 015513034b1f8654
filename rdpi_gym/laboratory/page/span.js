// Dragging over a plot marks a stretch of its horizontal axis.

const LEAST_PX = 4;

const axisOf = (box) => box._fullLayout?.xaxis;

/** The value under a pixel of the page. */
function valueAt(box, clientX) {
  const axis = axisOf(box);
  const px = clientX - box.getBoundingClientRect().left - axis._offset;
  const within = Math.min(Math.max(px, 0), axis._length);
  const linear = axis.p2l(within);
  return axis.type === "log" ? 10 ** linear : linear;
}

/**
 * Let a stretch be dragged over a plot.
 *
 * `done(from, to)` is called with values of the axis, `cleared()` on a double click, and
 * `zoomed(at, factor)` when the wheel is turned with Ctrl held.
 */
export function draggable(box, {done, cleared, zoomed}) {
  let start = null;
  let mark = null;
  const inside = (event) => {
    const axis = axisOf(box);
    if (!axis) return false;
    const frame = box.getBoundingClientRect();
    const px = event.clientX - frame.left;
    return px >= axis._offset - 6 && px <= axis._offset + axis._length + 6;
  };
  box.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !inside(event)) return;
    start = event.clientX;
    box.setPointerCapture(event.pointerId);
  });
  box.addEventListener("pointermove", (event) => {
    if (start === null) return;
    if (!mark && Math.abs(event.clientX - start) < LEAST_PX) return;
    if (!mark) {
      mark = document.createElement("div");
      mark.className = "dragged";
      box.append(mark);
    }
    const frame = box.getBoundingClientRect();
    const axis = axisOf(box);
    const clamp = (x) => Math.min(Math.max(x - frame.left, axis._offset), axis._offset + axis._length);
    const [a, b] = [clamp(start), clamp(event.clientX)].sort((p, q) => p - q);
    mark.style.left = `${a}px`;
    mark.style.width = `${b - a}px`;
  });
  const end = (event) => {
    if (start !== null && mark && event.type === "pointerup") {
      const [from, to] = [valueAt(box, start), valueAt(box, event.clientX)].sort((p, q) => p - q);
      if (to > from) done(from, to);
    }
    start = null;
    mark?.remove();
    mark = null;
  };
  box.addEventListener("pointerup", end);
  box.addEventListener("pointercancel", end);
  box.addEventListener("dblclick", () => cleared());
  if (zoomed) {
    box.addEventListener("wheel", (event) => {
      if (!event.ctrlKey || !inside(event)) return;
      event.preventDefault();
      zoomed(valueAt(box, event.clientX), event.deltaY > 0 ? 1.25 : 0.8);
    }, {passive: false});
  }
}
