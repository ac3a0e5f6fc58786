"""How much light a crown returns near its biting edge, and a slab of the thickness that it has there.

Photons enter the flat face of a wedge at a distance from its edge, scatter evenly, and count where they leave by the face: by
reciprocity the reflectance of that place under even light from the front, in front of the dark. Needs numpy.

    python3 validation/crown_edge.py
"""

import numpy as np

INDEX = 1.6
SCATTERING_PER_MM = 2.4  # reduced, of enamel and dentin
ABSORPTION_PER_MM = 0.02
EDGE_MM, SLOPE = 0.9, 0.46  # thickness at the edge of an upper incisor, and its growth per mm
PHOTONS = 40_000
FAR_MM = 1e3


def fresnel(cosine, inside, outside):
    """Unpolarized reflectance."""
    sine2 = (inside / outside) ** 2 * (1 - cosine**2)
    refracted = np.sqrt(np.maximum(0, 1 - sine2))
    s = (inside * cosine - outside * refracted) / (inside * cosine + outside * refracted)
    p = (inside * refracted - outside * cosine) / (inside * refracted + outside * cosine)
    return np.where(sine2 >= 1, 1, 0.5 * (s**2 + p**2))


def turned(cosine, rng):
    """Unit vectors at an angle from +x."""
    sine, turn = np.sqrt(1 - cosine**2), 2 * np.pi * rng.random(cosine.size)
    return np.stack([cosine, sine * np.cos(turn), sine * np.sin(turn)], 1)


def reflectance(thickness_mm, slope, from_edge_mm, rng):
    """Share of even light from the front that leaves by the face x = 0, the back x = thickness + slope z, the edge z = 0."""
    extinction = SCATTERING_PER_MM + ABSORPTION_PER_MM
    cosine = np.sqrt(rng.random(PHOTONS))
    weight = 1 - fresnel(cosine, 1, INDEX)
    place = np.zeros((PHOTONS, 3))
    place[:, 2] = from_edge_mm
    direction = turned(np.sqrt(1 - (1 - cosine**2) / INDEX**2), rng)
    depth = rng.exponential(1 / extinction, PHOTONS)
    normals = np.array([[-1, 0, 0], np.array([1, 0, -slope]) / np.hypot(1, slope), [0, 0, -1]])
    alive, left = np.ones(PHOTONS, bool), 0.0
    while alive.any():
        index = np.nonzero(alive)[0]
        p, d = place[index], direction[index]
        toward = d @ normals.T
        distance = np.stack([p[:, 0], (thickness_mm + slope * p[:, 2] - p[:, 0]) * normals[1, 0], p[:, 2]], 1)
        with np.errstate(divide="ignore", invalid="ignore"):
            ways = np.where(toward > 0, np.maximum(distance, 0) / toward, np.inf)
        which, way = ways.argmin(1), ways.min(1)
        meets = way < depth[index]

        # Scatter evenly, with Russian roulette
        inside = index[~meets]
        place[inside] += direction[inside] * depth[inside, None]
        weight[inside] *= SCATTERING_PER_MM / extinction
        direction[inside] = turned(2 * rng.random(inside.size) - 1, rng)
        depth[inside] = rng.exponential(1 / extinction, inside.size)
        faint = inside[weight[inside] < 1e-3]
        survives = rng.random(faint.size) < 0.1
        alive[faint[~survives]] = False
        weight[faint[survives]] *= 10

        # Reflect at a face, or leave
        at_face, face, way = index[meets], which[meets], way[meets]
        place[at_face] += direction[at_face] * way[:, None]
        depth[at_face] -= way
        normal = normals[face]
        cosine = np.abs((direction[at_face] * normal).sum(1))
        stays = rng.random(at_face.size) < fresnel(cosine, INDEX, 1)
        back = at_face[stays]
        direction[back] -= 2 * cosine[stays, None] * normal[stays]
        left += weight[at_face[~stays & (face == 0)]].sum()
        alive[at_face[~stays]] = False
    return left / PHOTONS


def main():
    rng = np.random.default_rng(1)
    print("mm from the edge, thickness in mm, reflectance of the wedge, of a slab so thick, their ratio")
    for from_edge_mm in (0.25, 0.75, 1.5, 2.5, 4, 6):
        thickness_mm = EDGE_MM + SLOPE * from_edge_mm
        wedge = reflectance(EDGE_MM, SLOPE, from_edge_mm, rng)
        slab = reflectance(thickness_mm, 0, FAR_MM, rng)
        print(f"{from_edge_mm:5.2f} {thickness_mm:5.2f} {wedge:6.3f} {slab:6.3f} {wedge / slab:6.3f}")


if __name__ == "__main__":
    main()
