/** Drawing in the rhythm of the screen. */

/**
 * A function that asks for a picture: however often it is called, there is one in the next frame.
 * @param {() => void} draw @returns {() => void}
 */
export function oncePerFrame(draw) {
  let isDue = false;
  return () => {
    if (isDue) return;
    isDue = true;
    requestAnimationFrame(() => {
      isDue = false;
      draw();
    });
  };
}
