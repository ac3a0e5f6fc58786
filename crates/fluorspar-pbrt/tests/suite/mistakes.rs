//! Scenes that can't be: each with its place, what is wrong, and how to fix it.

use super::support::load_files;

fn refused(text: &str) -> String {
    let files: [(&str, &[u8]); 2] = [("s.pbrt", text.as_bytes()), ("bad.spd", b"400 1\n500 x\n")];
    let Err(error) = load_files(&files, &Default::default()) else { return "accepted".into() };
    let place = error.at.map_or_else(String::new, |[line, column]| format!("{line}:{column}: "));
    format!("{place}{}", error.message)
}

#[test]
fn what_can_not_be_is_refused_at_its_place() {
    let light = "LightSource \"infinite\"\n";
    let zeros = "0 ".repeat(9);
    for (text, expected) in [
        ("Camera \"spherical\"", "1:1: Camera \"spherical\" has no counterpart"),
        ("Camera \"perspective\" \"float fov\" 180", "1:1: a field of view of 180 degrees"),
        (
            "Camera \"perspective\" \"float screenwindow\" [ 1 0 -1 1 ]",
            "1:1: an empty screenwindow; give \"screenwindow\" [left right bottom top]",
        ),
        ("Film \"image\" \"float cropwindow\" [.5 .5 0 1]", "1:1: the crop of the film holds no pixel"),
        ("Camera \"realistic\"", "1:1: this camera needs a lens"),
        ("Film \"image\" \"integer xresolution\" 1000000000", "1:1: an image of 1000000000 x 720 pixels"),
        (light, "the scene has no objects; add a Shape"),
        ("Shape \"sphere\" \"float radius\" -1", "1:1: a radius of -1"),
        ("Scale 1 1 0 Shape \"sphere\"", "1:13: the transform of this shape flattens it"),
        ("Shape \"trianglemesh\" \"point P\" [0 0 0 1 0 0]", "1:1: a mesh needs \"integer indices\""),
        ("Shape \"trianglemesh\" \"integer indices\" [0 1 -1] \"point P\" [0 0 0]", "1:1: an index below 0"),
        (
            "Shape \"trianglemesh\" \"integer indices\" [0 1 7] \"point P\" [0 0 0 1 0 0]",
            "1:1: triangle 0 uses vertex 7",
        ),
        ("Shape \"plymesh\" \"string filename\" \"none.ply\"", "1:1: "),
        ("Shape \"plymesh\"", "1:1: a plymesh needs its file"),
        ("Material \"glass\" \"float eta\" 0.5 Shape \"sphere\"", "1:1: an index of 0.5"),
        (
            "Material \"metal\" \"spectrum eta\" \"metal-Xx-eta\" Shape \"sphere\"",
            "1:18: no data for \"metal-Xx-eta\"",
        ),
        ("Material \"matte\" \"spectrum Kd\" \"bad.spd\" Shape \"sphere\"", "1:18: "),
        ("Material \"matte\" \"blackbody Kd\" 1 Shape \"sphere\"", "1:18: a black body of 1 K"),
        ("Material \"mix\" Shape \"sphere\"", "1:1: a mixture needs two materials"),
        (
            "MakeNamedMaterial \"m\" \"string type\" \"mix\" \"string materials\" [ \"m\" \"m\" ] NamedMaterial \"m\" Shape \"sphere\"",
            "1:1: mixtures are nested more than",
        ),
        (
            "Texture \"t\" \"float\" \"scale\" \"texture tex1\" \"t\" Material \"plastic\" \"texture roughness\" \"t\" Shape \"sphere\"",
            "1:1: textures are nested more than",
        ),
        (
            "Texture \"t\" \"spectrum\" \"imagemap\" Material \"matte\" \"texture Kd\" \"t\" Shape \"sphere\"",
            "1:1: an imagemap needs an image",
        ),
        (
            "LightSource \"distant\" \"point from\" [0 0 1] \"point to\" [0 0 1]",
            "1:1: \"from\" and \"to\" are the same point",
        ),
        ("LightSource \"point\" \"spectrum I\" [400 -1 700 1]", "1:1: the spectrum of a light is -1"),
        (
            &format!("Material \"matte\" \"photolumi f\" [ 400 5 410 {zeros} 1 ] Shape \"sphere\""),
            "1:18: the matrix of 3 x 3 bands needs 9 numbers after the wavelengths; it has 10",
        ),
        (
            "Material \"matte\" \"photolumi f\" [ 400 -5 410 1 ] Shape \"sphere\"",
            "1:18: wavelengths from 400 to 410 nm by -5 nm",
        ),
    ] {
        let said = refused(text);
        assert!(said.starts_with(expected), "{text}\n{said}\n{expected}");
    }
}

/// Scenes of a few bytes that ask for endless work.
#[test]
fn hostile_scenes_are_refused_quickly() {
    let started = std::time::Instant::now();
    let mut text = String::from("Texture \"t0\" \"spectrum\" \"checkerboard\"\n");
    for i in 1..60 {
        text.push_str(&format!(
            "Texture \"t{i}\" \"spectrum\" \"scale\" \"texture tex1\" \"t{0}\" \"texture tex2\" \"t{0}\"\n",
            i - 1
        ));
    }
    text.push_str("Material \"matte\" \"texture Kd\" \"t59\" Shape \"sphere\"\nLightSource \"infinite\"");
    let said = super::support::load_files(&[("s.pbrt", text.as_bytes())], &Default::default());
    assert!(said.is_ok() || said.is_err_and(|error| error.at.is_some()));
    let mut text = String::new();
    for i in 0..80 {
        text.push_str(&format!("Texture \"t{i}\" \"float\" \"bilerp\"\nMaterial \"plastic\" \"texture roughness\" \"t{i}\" Shape \"sphere\"\n"));
    }
    assert!(refused(&text).contains("textures that have to be sampled"));
    assert!(started.elapsed().as_secs() < 60);
}

/// Changed bytes and words of a scene with one of everything: an error with words or a scene, never a panic, soon.
///
/// 500 scenes; `FLUORSPAR_MUTATIONS=100000 cargo test -p fluorspar-pbrt --test suite damaged` makes as many.
#[test]
fn damaged_scenes_never_panic() {
    let text = "Option \"seed\" 3 Scale -1 1 1 LookAt 0 0 5 0 0 0 0 1 0\nCamera \"perspective\" \"float fov\" 40\nFilm \"rgb\" \"integer xresolution\" 4\n\
        WorldBegin LightSource \"infinite\" \"blackbody L\" 5000 LightSource \"spot\" \"float coneangle\" 20\n\
        Texture \"c\" \"float\" \"checkerboard\" \"float uscale\" 3 \"float tex1\" 0.5\n\
        Texture \"t\" \"spectrum\" \"scale\" \"rgb tex1\" [ 0.1 0.2 0.3 ] \"texture tex2\" \"c\"\n\
        MakeNamedMaterial \"m\" \"string type\" \"matte\" \"texture Kd\" \"t\" \"photolumi f\" [ 400 5 405 0 0 0.1 0 ]\n\
        MakeNamedMaterial \"n\" \"string type\" \"metal\" \"spectrum eta\" [ 400 1 500 2 ] \"float roughness\" 0.1\n\
        MakeNamedMaterial \"x\" \"string type\" \"mix\" \"string materials\" [ \"m\" \"n\" ] \"float amount\" 0.5\n\
        AttributeBegin Translate 0 1 0 NamedMaterial \"x\" Shape \"cylinder\" \"float radius\" 2 AttributeEnd\n\
        NamedMaterial \"m\" AreaLightSource \"diffuse\" \"spectrum L\" [ 400 1 700 2 ] \"float power\" 5\n\
        Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 ] \"point3 P\" [ 0 0 0 1 0 0 0 1 0 ] \"float alpha\" 1\n\
        ObjectBegin \"o\" Material \"glass\" Shape \"disk\" ObjectEnd ObjectInstance \"o\"\n";
    assert!(load_files(&[("s.pbrt", text.as_bytes())], &Default::default()).is_ok());
    let mut state = 7_u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let words: Vec<&str> = text.split_whitespace().collect();
    let numbers =
        ["-1", "0", "1e300", "-1e-300", "nan", "4294967296", "9007199254740993", "[", "]", "\"", "true"];
    let rounds = std::env::var("FLUORSPAR_MUTATIONS").map_or(500, |count| count.parse().unwrap());
    let (mut read, mut slowest) = (0, 0.0_f64);
    for round in 0..rounds {
        let mut changed = words.clone();
        for _ in 0..random(3) {
            let (at, other) = (random(changed.len()), random(words.len()));
            match random(4) {
                0 => changed[at] = words[other],
                1 => changed[at] = numbers[random(numbers.len())],
                2 => changed.insert(at, words[other]),
                _ => drop(changed.remove(at)),
            }
        }
        let mut bytes = changed.join(" ").into_bytes();
        for _ in 0..random(3) {
            let at = random(bytes.len());
            match random(4) {
                0 => bytes[at] = b" 0123456789.-e[]\"\n#abnx"[random(23)],
                1 => {
                    bytes.remove(at);
                }
                2 => bytes.insert(at, b"0123456789-e[]\""[random(15)]),
                _ => bytes.truncate(at.max(10)),
            }
        }
        let started = std::time::Instant::now();
        let result = load_files(&[("s.pbrt", &bytes)], &Default::default());
        slowest = slowest.max(started.elapsed().as_secs_f64());
        read += usize::from(result.is_ok());
        let text = String::from_utf8_lossy(&bytes);
        assert!(
            result.is_ok() || result.is_err_and(|error| !error.message.is_empty()),
            "round {round}: {text}"
        );
        // Three seconds on a processor of its own.
        assert!(slowest < 30.0, "round {round}: {slowest} s: {text}");
    }
    eprintln!("{rounds} damaged scenes, {read} read, the slowest took {slowest:.2} s");
    assert!(read < rounds, "no change did any damage");
}
