// Draws an octree with potree-core on a page of another origin than the daemon's,
// and tells the page's own server what was seen.
//
// The page's address: ?url=METADATA and, if the viewer is to send a token, &token=SECRET

import * as THREE from 'three';
import { Potree } from 'potree-core';

const asked = new URLSearchParams(location.search);
const [url, token] = [asked.get('url'), asked.get('token')];
const statuses = [];

/** potree-core asks this for each file; the place for a token. */
const requests = {
  getUrl: async (address) => address,
  fetch: async (address, options = {}) => {
    const headers = token ? { ...options.headers, authorization: `Bearer ${token}` } : options.headers;
    const answer = await fetch(address, { ...options, headers });
    statuses.push(answer.status);
    return answer;
  },
};

const frame = () => new Promise(requestAnimationFrame);

async function draw() {
  const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
  renderer.setSize(320, 240);
  document.body.append(renderer.domElement);
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(60, 4 / 3, 0.1, 1e7);
  const potree = new Potree();
  const cloud = await potree.loadPointCloud(url, requests);
  cloud.material.size = 3;
  scene.add(cloud);
  const box = cloud.pcoGeometry.boundingBox.clone().translate(cloud.position);
  const middle = box.getCenter(new THREE.Vector3());
  const size = box.getSize(new THREE.Vector3()).length();
  camera.position.copy(middle).add(new THREE.Vector3(0, 0, size));
  camera.lookAt(middle);
  camera.updateMatrixWorld();
  const gl = renderer.getContext();
  const bytes = new Uint8Array(320 * 240 * 4);
  const background = new THREE.Color(0x204060);
  renderer.setClearColor(background);
  let seen = { nodes: 0, pixels: 0 };
  for (let turn = 0; turn < 600 && !(seen.nodes > 0 && seen.pixels > 500); turn++) {
    potree.updatePointClouds([cloud], camera, renderer);
    renderer.render(scene, camera);
    gl.readPixels(0, 0, 320, 240, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    let pixels = 0;
    for (let i = 4; i < bytes.length; i += 4) {
      if (bytes[i] !== bytes[0] || bytes[i + 1] !== bytes[1] || bytes[i + 2] !== bytes[2]) pixels += 1;
    }
    seen = { nodes: cloud.visibleNodes.length, pixels, points: cloud.pcoGeometry.root.numPoints };
    await frame();
  }
  return seen;
}

let told;
try {
  told = await draw();
} catch (error) {
  // A refusal that may not be read is an error of the network to a page.
  told = { error: String(error) };
}
await fetch('/seen', { method: 'POST', body: JSON.stringify({ ...told, statuses }) });
