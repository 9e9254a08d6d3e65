// Loads an octree with potree-core to its last node and says in `window.seen` which
// points came: their number by color. The page's address: ?url=METADATA

import * as THREE from 'three';
import { Potree } from 'potree-core';

const url = new URLSearchParams(location.search).get('url');
const requests = { getUrl: async (address) => address, fetch: (...request) => fetch(...request) };
const frame = () => new Promise(requestAnimationFrame);

const renderer = new THREE.WebGLRenderer();
renderer.setSize(320, 240);
document.body.append(renderer.domElement);
const potree = new Potree();
potree.pointBudget = 10_000_000;
window.seen = { points: 0, colors: {} };
const cloud = await potree.loadPointCloud(url, requests);
cloud.minNodePixelSize = 0;
const scene = new THREE.Scene();
scene.add(cloud);
const camera = new THREE.PerspectiveCamera(60, 4 / 3, 0.1, 1e7);
const box = cloud.pcoGeometry.boundingBox.clone().translate(cloud.position);
const middle = box.getCenter(new THREE.Vector3());
camera.position.copy(middle).add(new THREE.Vector3(0, 0, box.getSize(new THREE.Vector3()).length()));
camera.lookAt(middle);
camera.updateMatrixWorld();
for (;;) {
  potree.updatePointClouds([cloud], camera, renderer);
  renderer.render(scene, camera);
  const colors = {};
  let points = 0;
  for (const node of cloud.visibleNodes) {
    const { rgba } = node.sceneNode.geometry.attributes;
    points += rgba.count;
    for (let at = 0; at < rgba.count; at += 1) {
      const color = [0, 1, 2].map((i) => rgba.array[4 * at + i]).join(',');
      colors[color] = (colors[color] ?? 0) + 1;
    }
  }
  window.seen = { points, colors };
  await frame();
}
