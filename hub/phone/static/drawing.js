// The skeleton over the picture, with a frame around the person who is followed.
const BONES = [
  ["left_hand", "left_elbow"], ["left_elbow", "left_shoulder"], ["left_shoulder", "neck"],
  ["right_hand", "right_elbow"], ["right_elbow", "right_shoulder"], ["right_shoulder", "neck"],
  ["neck", "head"], ["neck", "pelvis"],
  ["pelvis", "left_hip"], ["left_hip", "left_knee"], ["left_knee", "left_foot"],
  ["pelvis", "right_hip"], ["right_hip", "right_knee"], ["right_knee", "right_foot"],
];
const SEEN = 0.5;

export function draw(canvas, video, parts) {
  if (canvas.width !== video.videoWidth || canvas.height !== video.videoHeight) {
    canvas.width = video.videoWidth;
    canvas.height = video.videoHeight;
  }
  const pen = canvas.getContext("2d");
  pen.clearRect(0, 0, canvas.width, canvas.height);
  const places = Object.values(parts).filter((place) => place);
  if (!places.length) return;
  const unit = Math.max(canvas.width, canvas.height) / 160;
  pen.lineWidth = unit;
  for (const [from, to] of BONES) {
    const [a, b] = [parts[from], parts[to]];
    if (!a || !b) continue;
    pen.strokeStyle = a[2] >= SEEN && b[2] >= SEEN ? "#5fe08f" : "#f2b84b";
    pen.beginPath();
    pen.moveTo(a[0], a[1]);
    pen.lineTo(b[0], b[1]);
    pen.stroke();
  }
  for (const [u, v, sure] of places) {
    pen.fillStyle = sure >= SEEN ? "#fff" : "#f2b84b";
    pen.beginPath();
    pen.arc(u, v, unit, 0, 7);
    pen.fill();
  }
  const [us, vs] = [places.map((place) => place[0]), places.map((place) => place[1])];
  const edge = 4 * unit;
  pen.strokeStyle = "#fff8";
  pen.strokeRect(
    Math.min(...us) - edge, Math.min(...vs) - edge,
    Math.max(...us) - Math.min(...us) + 2 * edge, Math.max(...vs) - Math.min(...vs) + 2 * edge,
  );
}
