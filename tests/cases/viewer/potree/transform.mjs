// Where points lie by the proj4.js that Potree 1.8 ships. Standard input: a list of
// [projection, x, y] or [projection, x, y, z]; standard output: a list of
// [longitude, latitude], or of an error's text.
import { readFileSync } from 'node:fs';
import proj4 from 'proj4';

const points = JSON.parse(readFileSync(0, 'utf8'));
const places = points.map(([projection, ...point]) => {
  try {
    return proj4(projection, 'WGS84').forward(point);
  } catch (error) {
    return String(error);
  }
});
console.log(JSON.stringify(places));
