// The names of the vehicles: each stands beside its vehicle where it hides least of the others.

const LINE_PX = 14, ICON_PX = 9, GAP_PX = 11, OUTSIDE = 1e4;

// Places of a name with its left upper corner relative to the vehicle, the preferred one first.
function places(width) {
  const right = GAP_PX, left = -GAP_PX - width, middle = -width / 2, above = -GAP_PX - LINE_PX, below = GAP_PX;
  return [
    [right, -LINE_PX / 2], [left, -LINE_PX / 2], [middle, above], [middle, below],
    [right, above], [right, below], [left, above], [left, below],
  ];
}

function overlap([left, top, right, bottom], other) {
  const wide = Math.min(right, other[2]) - Math.max(left, other[0]);
  const high = Math.min(bottom, other[3]) - Math.max(top, other[1]);
  return wide > 0 && high > 0 ? wide * high : 0;
}

export default {
  draw_names(context) {
    const { clientWidth, clientHeight } = context.canvas;
    const vehicles = Object.values(this.vehicles).filter((vehicle) => vehicle.position);
    const taken = vehicles.map(({ position }) => {
      const [x, y] = this.place(position);
      return [x - ICON_PX, y - ICON_PX, x + ICON_PX, y + ICON_PX];
    });
    context.font = "600 12px system-ui, sans-serif";
    context.lineWidth = 3;
    context.strokeStyle = this.options.dark ? "#101418" : "#fff";
    context.fillStyle = this.ink;
    for (const vehicle of vehicles) {
      const is_old = vehicle.is_silent && vehicle.age_s !== null;
      const text = is_old ? `${vehicle.name} (unheard for ${Math.round(vehicle.age_s)} s)` : vehicle.name;
      const width = context.measureText(text).width, [x, y] = this.place(vehicle.position);
      let best = null, least = Infinity;
      for (const [dx, dy] of places(width)) {
        const box = [x + dx, y + dy, x + dx + width, y + dy + LINE_PX];
        const is_outside = box[0] < 0 || box[1] < 0 || box[2] > clientWidth || box[3] > clientHeight;
        const hidden = taken.reduce((sum, other) => sum + overlap(box, other), is_outside ? OUTSIDE : 0);
        if (hidden < least) [best, least] = [box, hidden];
      }
      taken.push(best);
      context.globalAlpha = vehicle.is_silent ? 0.45 : 1;
      context.strokeText(text, best[0], best[3] - 3);
      context.fillText(text, best[0], best[3] - 3);
    }
    context.globalAlpha = 1;
  },
};
