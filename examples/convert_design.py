"""Makes a design file of format 2 of one of format 1: python convert_design.py OLD.toml > NEW.toml"""

import sys
import tomllib

MOVED = "title description criterion criterion_contrast spectral excitation cohort exposure unknown limit search tolerance".split()
LISTS = "region fluorophore tissue contrast compare".split()


def toml(value):
    """A value as it is written in one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key if key.isidentifier() else toml(key)} = {toml(v)}" for key, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
    return str(value).lower() if isinstance(value, bool) else repr(value)


def edge(filter_, nm):
    """A long-pass edge as a filter."""
    return {
        "type": "edges",
        "peak": 1.0,
        "optical_density": filter_.get("optical_density", 5.0),
        "edges": [{"pass": "long", "cut_nm": nm, "width_nm": filter_.get("edge_width_nm", 8.0)}],
    }


def convert(old):
    """The sections of the new file."""
    new = {"format": 2} | {key: old[key] for key in MOVED if key in old}
    scene, lens, exposure = old.get("scene"), old.get("lens", {}), dict(old.get("exposure", {}))
    vary, named = [], lambda field, choices: {"field": field, "names": [c["name"] for c in choices], "values": []}
    regions = [dict(region) for region in old.get("region", [])]

    # The experiment: the scene, or parallel light
    light = (scene or {}).get("light_group") or "light"
    if scene:
        new["base"] = scene.get("preset") or scene["file"]
        for region in (region for region in regions if "rendered" in region):
            region["rendered"] = {**region["rendered"], "set": scene.get("set", []) + region["rendered"].get("set", [])}
        if "peaks_nm" in scene:
            new["render"] = {"excitation_basis_nm": scene["peaks_nm"]}
        if "light_group" not in scene:
            print(f"# Name the designed light of the base where \"{light}\" stands.")
    new["lens"] = {"type": "ideal", "focal_length_mm": lens.get("focal_length_mm", 3.0), "transmittance": lens.get("transmittance", 1.0)}
    apart = any("working_distance_mm" in geometry for geometry in old.get("geometry", []))
    if not apart:
        new["lens"]["focus_distance_mm"] = lens.get("distance_mm", 1e9)
    if "eye" in old and scene:
        eye = old["eye"]
        new["safety"] = {"aphakic": eye.get("aphakic", False)} | ({"patient_eye_distance_mm": eye["distance_mm"]} if "distance_mm" in eye else {})
    elif "eye" in old:
        new["safety"] = {"aphakic": old["eye"].get("aphakic", False)}
        new["eye"] = {key: value for key, value in old["eye"].items() if key != "aphakic"}
    if "safety_margin" in new.get("limit", {}):
        new["limit"] = {"tissue_margin" if key == "safety_margin" else key: value for key, value in new["limit"].items()}

    def strength(choice):
        if not scene:
            return {"strength": {"irradiance_w_per_m2": choice.get("irradiance_w_per_m2", 10.0)}}
        if "power_mw" in choice and choice.get("filters"):
            print(f"# {choice['name']}: {choice['power_mw']} mW were behind the filters; here the power is before them.")
        return {"strength": {"power_mw": choice["power_mw"]}} if "power_mw" in choice else {}

    def source(name, choice):
        return {"name": name, "type": "distant", "frame": "camera", "spectrum": choice["spectrum"]} | strength(choice)

    # Lights
    lights, led = old.get("light", []), old.get("led")
    choice = named(f"light.{light}", lights) | {"name": "light"}
    choice["values"] = [{"spectrum": c["spectrum"], "filters": c.get("filters", [])} | strength(c) for c in lights]
    costs = [c.get("cost", 0.0) for c in lights]
    if led is not None:
        choice["led"] = {key: led[key] for key in ("peaks_nm", "fwhm_nm", "short_pass_after_peak_nm") if key in led}
        peaks = led.get("peaks_nm", [340.0 + 5.0 * k for k in range(33)])
        choice["names"] += [f"{nm:g} nm" for nm in peaks]
        costs += [led.get("cost", 0.0)] * len(peaks)
    choice["costs"] = costs if any(costs) else []
    vary.append(choice)
    if not scene:
        new["light"] = [source(light, {"name": light, "spectrum": 1.0} | (led or {}))]
    elif led is not None:
        new["light"] = [{"name": light, "filters": []} | strength({"name": "led"} | led)]

    # The white frame
    if white := exposure.pop("white", None):
        new.setdefault("light", []).append(source("white", {"name": "white", "spectrum": "white_led"} | white))
        exposure["white"] = {"light": "white"} | {key: white[key] for key in ("filters", "level", "cost") if key in white}

    # Viewing filters: edges of one section stay edges, those of several become filters
    filters = old.get("view_filter", [])
    with_edges = [f for f in filters if f.get("long_pass_nm") or f.get("long_pass_after_peak_nm")]
    choice = {"name": with_edges[0]["name"] if with_edges else "view_filter", "field": "view_filter.filters", "values": [], "names": [], "costs": []}
    for f in sorted(filters, key=lambda f: f in with_edges[:1]):
        own, edges, after = f.get("filters", []), f.get("long_pass_nm", []), f.get("long_pass_after_peak_nm", [])
        if f in with_edges[:1]:
            new["view_filter"] = {"filters": own}
            choice["long_pass"] = {"edges_nm": edges, "after_peak_nm": after, "width_nm": f.get("edge_width_nm", 8.0), "optical_density": f.get("optical_density", 5.0)}
        else:
            choice["values"] += [own + [edge(f, nm)] for nm in edges] or [own]
        choice["names"] += [f"{f['name']} {nm:g} nm" for nm in edges] + [f"{f['name']} peak + {nm:g} nm" for nm in after] or [f["name"]]
        choice["costs"] += [f.get("cost", 0.0)] * max(1, len(edges) + len(after))
    if filters:
        vary.append(choice)
    else:
        new["view_filter"] = {"filters": []}

    # Sensors: those of the catalogue, ideal bands, files
    order = {"preset": 0, "bands": 1, "file": 2}
    kind = lambda s: next(key for key in order if key in s)
    sensors = sorted(old.get("sensor", []), key=lambda s: order[kind(s)])
    choice = named("sensor", sensors) | {"name": "sensor", "costs": [s.get("cost", 0.0) for s in sensors]}
    for s in sensors:
        if kind(s) == "preset":
            extra = {"filters": s["filters"]} if s.get("filters") else {}
            choice["values"].append({"preset": s["preset"]} | extra)
        else:
            choice.setdefault({"bands": "bands", "file": "sensor_files"}[kind(s)], []).append(s[kind(s)])
            if s.get("filters"):
                print(f"# {s['name']}: the filters on the sensor belong to its file or section now.")
        if s.get("gain", 1.0) != 1.0:
            print(f"# {s['name']}: give the gain {s['gain']} as sensor.analog_gain.")
        if "wheel" in s:
            exposure["wheel"] = s["wheel"]
    vary += [choice] if sensors else []
    vary.append({"name": "aperture", "field": "lens.f_number", "values": lens.get("f_numbers", [4.0])})
    vary += [{key: g[key] for key in ("name", "field", "values") if key in g} for g in old.get("geometry", [])]

    if exposure:
        new["exposure"] = exposure
    for section in vary:
        for key in [key for key, value in section.items() if value == [] or key == "costs" and not any(value)]:
            del section[key]
    return new | {"region": regions} | {key: old[key] for key in LISTS[1:] if key in old} | {"vary": vary}


def main():
    with open(sys.argv[1], "rb") as file:
        old = tomllib.load(file)
    if old.get("format") != 1:
        sys.exit(f"{sys.argv[1]}: this is no design file of format 1")
    new = convert(old)
    is_list = lambda value: isinstance(value, list) and value and all(isinstance(item, dict) for item in value)
    for key, value in new.items():
        if not is_list(value):
            print(f"{key} = {toml(value)}")
    for key, value in new.items():
        for entry in value if is_list(value) else []:
            print(f"\n[[{key}]]")
            for field, inner in entry.items():
                print(f"{field} = {toml(inner)}")


main()
