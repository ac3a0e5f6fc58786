//! Scenes in the manner of the programs that write them, by hand.

use fluorspar::material::Scattering;
use fluorspar::scene::Shape;
use fluorspar_pbrt::{PbrtOptions, check_light};

use super::support::{has_read, load_files, load_text, remarks, rendered};

/// Two triangles as Blender's add-on writes meshes: a binary file, here compressed as well.
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property float nx\nproperty float ny\nproperty float nz\nproperty float u\nproperty float v\nelement face 1\n\
    property list uint8 int vertex_indices\nend_header\n-1 -1 0 0 0 1 0 0\n1 -1 0 0 0 1 1 0\n1 1 0 0 0 1 1 1\n-1 1 0 0 0 1 0 1\n4 0 1 2 3\n";

/// A 2 x 1 PFM image, dark and bright.
fn image() -> Vec<u8> {
    let mut bytes = b"PF\n2 1\n-1\n".to_vec();
    bytes.extend([0.0_f32, 0.0, 0.0, 0.5, 0.25, 0.125].iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

#[test]
fn a_scene_as_blender_writes_it_for_version_4() {
    let main = br#"
# pbrt v4 exporter
Film "rgb" "integer xresolution" [ 8 ] "integer yresolution" [ 6 ] "string filename" "out.exr" "string sensor" "canon_eos_100d"
Scale -1 1 1
Transform [ 1 0 0 0  0 0 -1 0  0 1 0 0  0 0 0 1 ]
LookAt 0 -5 0   0 0 0   0 0 1
Camera "perspective" "float fov" [ 40 ] "float screenwindow" [ -1.333333 1.333333 -1 1 ] "float shutteropen" 0
Sampler "zsobol" "integer pixelsamples" [ 8 ]
PixelFilter "gaussian" "float xradius" 1.5
Integrator "volpath" "integer maxdepth" [ 6 ] "bool regularize" [ true ]
ColorSpace "srgb"
WorldBegin
Texture "wood" "spectrum" "imagemap" "string filename" "textures/wood.pfm" "string encoding" "linear"
MakeNamedMaterial "floor" "string type" "coateddiffuse" "texture reflectance" "wood" "float roughness" 0.1
MakeNamedMaterial "ball" "string type" "dielectric" "spectrum eta" "glass-BK7"
MakeNamedMaterial "metal" "string type" "conductor" "spectrum eta" "metal-Au-eta" "spectrum k" "metal-Au-k" "float roughness" 0.2
MakeNamedMaterial "both" "string type" "mix" "string materials" [ "metal" "floor" ] "float amount" 0.25
AttributeBegin
    Transform [ 2 0 0 0 0 2 0 0 0 0 2 0 0 0 -1 1 ]
    NamedMaterial "floor"
    Shape "plymesh" "string filename" "meshes/Plane.ply"
AttributeEnd
AttributeBegin
    Translate 0 0 1
    NamedMaterial "ball" Shape "sphere" "float radius" 0.5
    Translate 2 0 0 NamedMaterial "both" Shape "sphere" "float radius" 0.5
AttributeEnd
AttributeBegin
    AreaLightSource "diffuse" "blackbody L" 5500 "float scale" 20 "bool twosided" false
    NamedMaterial "interface"
AttributeEnd
MakeNamedMaterial "interface" "string type" "interface"
LightSource "infinite" "rgb L" [ 0.4 0.45 0.5 ] "float scale" 0.5
"#;
    let files: [(&str, &[u8]); 3] =
        [("scene.pbrt", main), ("meshes/Plane.ply", PLY.as_bytes()), ("textures/wood.pfm", &image())];
    let study = load_files(&files, &PbrtOptions::default()).unwrap();
    let scene = &study.study.scene;
    assert_eq!(
        (scene.camera.width, scene.camera.height, scene.objects.len(), scene.lights.len()),
        (8, 6, 3, 1)
    );
    assert_eq!((study.study.render.samples_per_pixel, study.study.render.max_depth), (8, 6));
    assert!((scene.camera.tan_half_width - 20.0_f32.to_radians().tan() * 4.0 / 3.0).abs() < 1e-5);
    assert!(matches!(scene.materials[scene.objects[1].material].scattering, Scattering::Dielectric(_)));
    let Scattering::Mixture(mix) = &scene.materials[scene.objects[2].material].scattering else { panic!() };
    assert_eq!((mix.amount.constant(), scene.materials[mix.first].name.as_str()), (Some(0.25), "metal"));
    assert_eq!(scene.objects[0].name, "Plane_0");
    assert!(has_read(&study, "meshes/Plane.ply") && has_read(&study, "textures/wood.pfm"));
    let image = rendered(&study, 8, 40);
    assert!(image.mean.iter().all(|value| value.is_finite() && *value > 0.0));
}

#[test]
fn a_scene_as_cinema_4d_writes_it_for_version_3() {
    let main = br#"
Scale -1 1 1
LookAt 0 0 300  0 0 0  0 1 0
Camera "perspective" "float fov" [ 30 ] "float focaldistance" [ 300 ] "float lensradius" [ 0 ]
Film "image" "integer xresolution" [ 8 ] "integer yresolution" [ 8 ] "string filename" [ "x.exr" ]
Sampler "lowdiscrepancy" "integer pixelsamples" [ 4 ]
SurfaceIntegrator "path" "integer maxdepth" [ 3 ]
WorldBegin
Include "x_materials.pbrt"
Include "x_geometry.pbrt"
LightSource "distant" "color L" [ 1 1 1 ] "point from" [ 0 0 1 ] "point to" [ 0 0 0 ]
WorldEnd
"#;
    let materials = br#"
Texture "fur_kd" "color" "imagemap" "string filename" "fur.pfm" "bool gamma" "false"
MakeNamedMaterial "Lips" "string type" "plastic" "color Kd" [ 0.5 0.2 0.2 ] "color Ks" [ 0.2 0.2 0.2 ] "float roughness" [ 0.05 ]
MakeNamedMaterial "Fur" "string type" "uber" "texture Kd" "fur_kd" "color opacity" [ 0.5 0.5 0.5 ]
"#;
    let geometry = br#"
AttributeBegin
  ConcatTransform [ 10 0 0 0  0 10 0 0  0 0 10 0  0 0 0 1 ]
  NamedMaterial "Lips"
  Shape "trianglemesh" "integer indices" [ 0 1 2 ] "point P" [ -1 -1 0  1 -1 0  1 1 0 ] "normal N" [ 0 0 1 0 0 1 0 0 1 ]
    "float uv" [ 0 0 1 0 1 1 ]
  NamedMaterial "Fur"
  Shape "trianglemesh" "integer indices" [ 0 1 2 ] "point P" [ -1 -1 0  1 1 0  -1 1 0 ] "float st" [ 0 0 1 0 1 1 ]
AttributeEnd
"#;
    let files: [(&str, &[u8]); 4] = [
        ("x.pbrt", main),
        ("x_materials.pbrt", materials),
        ("x_geometry.pbrt", geometry),
        ("fur.pfm", &image()),
    ];
    let study = load_files(&files, &PbrtOptions { unit_m: 0.001, ..PbrtOptions::default() }).unwrap();
    let scene = &study.study.scene;
    assert_eq!(scene.objects.len(), 2);
    let lips = &scene.materials[scene.objects[0].material];
    assert_eq!(
        (lips.name.as_str(), lips.coat().is_some(), scene.materials[1].opacity.is_some()),
        ("Lips", true, true)
    );
    let Shape::Mesh(mesh) = &scene.objects[0].shape else { panic!() };
    assert!((mesh.bounds().1.x - 0.01).abs() < 1e-6 && (scene.camera.position.length() - 0.3).abs() < 1e-5);
    assert_eq!(study.study.render.max_depth, 3);
    assert!(rendered(&study, 4, 20).mean[20] > 0.0);
}

#[test]
fn a_scene_as_iset3d_writes_it() {
    let main = br#"
# PBRT file created with piWrite (Version 3.0)
LookAt 0 0 1 0 0 0 0 1 0
Sampler "halton"
  "integer pixelsamples" [8]
Integrator "path"
  "integer maxdepth" [1]
PixelFilter "box"
  "float xwidth" [0.5]
Film "image"
  "string filename" "renderings/oral.dat"
  "integer xresolution" [8]
  "integer yresolution" [8]
Camera "pinhole"
  "float fov" [40]
WorldBegin
AttributeBegin
  LightSource "distant" "spectrum L" "spds/lights/OralEye_UV.spd" "spectrum scale" [ 400 2 700 2 ]
    "point from" [ 0 0 1 ] "point to" [ 0 0 0 ]
AttributeEnd
Include "oral_materials.pbrt"
Include "oral_geometry.pbrt"
WorldEnd
"#;
    let materials = br#"
MakeNamedMaterial "tongue" "string type" "matte" "spectrum Kd" [ 400 0.2 700 0.6 ]
  "photolumi fluorescence" [ 380 10 400 0 0 0 0.5 0 0 0.25 1 0 ] "float concentration" [ 0.1000 ]
"#;
    let geometry = br#"
ObjectBegin "tongue_I"
  AttributeBegin
    NamedMaterial "tongue"
    Shape "plymesh" "string filename" "scene/PBRT/pbrt-geometry/tongue.ply"
  AttributeEnd
ObjectEnd
AttributeBegin
  #ObjectName tongue_B:Vector(0.1, 0.1, 0.1)
  Translate 0.1 0 0
  Scale 0.1 0.1 0.1
  ObjectInstance "tongue_I"
AttributeEnd
AttributeBegin
  ConcatTransform [ 0.1 0 0 0 0 0.1 0 0 0 0 0.1 0 -0.1 0 0 1 ]
  ObjectInstance "tongue_I"
AttributeEnd
"#;
    let files: [(&str, &[u8]); 5] = [
        ("oral.pbrt", main),
        ("oral_materials.pbrt", materials),
        ("oral_geometry.pbrt", geometry),
        ("scene/PBRT/pbrt-geometry/tongue.ply", PLY.as_bytes()),
        ("spds/lights/OralEye_UV.spd", b"# nm  W/(m2 nm)\n370 0\n385 0.5\n400 0\n"),
    ];
    let study = load_files(&files, &PbrtOptions::default()).unwrap();
    let scene = &study.study.scene;
    let Shape::Instances(many) = &scene.objects[0].shape else { panic!() };
    assert_eq!((scene.objects.len(), many.instances.len(), scene.fluorophores.len()), (1, 2, 1));
    assert_eq!(scene.materials[0].fluorophores[0].concentration.constant(), Some(0.1));
    assert!((scene.lights[0].spectrum.at(385.0) - 1.0).abs() < 1e-9);
    assert!(has_read(&study, "OralEye_UV.spd"));
    // What the spectra lack is named, and nothing else is.
    assert!(
        remarks(&study).iter().all(|text| text.starts_with("the spectrum covers")),
        "{:?}",
        remarks(&study)
    );
    let image = rendered(&study, 8, 10);
    let at = |nm: f64| image.mean[image.grid.bin_of(nm).unwrap()];
    assert!(at(385.0) > 0.0 && at(400.0) > 0.0 && at(500.0) == 0.0);
}

/// Every material and shape of the book's scenes, as pbrt's own converters write them.
#[test]
fn every_material_and_shape_is_understood_or_named() {
    let materials = [
        "matte",
        "plastic",
        "metal",
        "glass",
        "mirror",
        "substrate",
        "uber",
        "translucent",
        "kdsubsurface",
        "disney",
        "hair",
        "fourier",
        "subsurface",
        "diffuse",
        "coateddiffuse",
        "conductor",
        "coatedconductor",
        "dielectric",
        "thindielectric",
        "diffusetransmission",
        "measured",
        "interface",
        "none",
        "",
    ];
    let shapes = [
        "sphere",
        "disk",
        "cylinder",
        "cone",
        "paraboloid",
        "hyperboloid",
        "heightfield",
        "nurbs",
        "curve",
        "Shape \"sphere\" \"float zmin\" 0 \"float phimax\" 200",
    ];
    let mut text =
        String::from("Camera \"perspective\" WorldBegin LightSource \"infinite\" Translate 0 0 9\n");
    for material in materials {
        text.push_str(&format!("Material \"{material}\"\n"));
        for shape in shapes {
            let directive =
                if shape.starts_with("Shape") { shape.to_string() } else { format!("Shape \"{shape}\"") };
            text.push_str(&format!("{directive}\n"));
        }
    }
    text.push_str("Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0]\n");
    let study = load_text(&text);
    let found = remarks(&study);
    for name in ["hyperboloid", "heightfield", "nurbs", "curve", "hair", "measured", "diffusetransmission"] {
        assert!(found.iter().any(|text| text.contains(&format!("\"{name}\" has no counterpart"))), "{name}");
    }
    // 21 materials with a surface, 6 shapes each; the patch stands on no surface.
    assert_eq!(study.study.scene.objects.len(), 21 * 6);
    assert!(study.study.scene.check().is_ok());
}

#[test]
fn textures_are_sums_of_spectra_with_weights() {
    let text = r#"
Camera "perspective" WorldBegin LightSource "infinite"
Texture "red" "spectrum" "constant" "rgb value" [ 0.8 0 0 ]
Texture "checks" "spectrum" "checkerboard" "float uscale" 4 "float vscale" 2 "texture tex1" "red" "rgb tex2" [ 0 0 0.5 ]
Texture "half" "float" "constant" "float value" 0.5
Texture "scaled" "spectrum" "scale" "texture tex1" "checks" "texture tex2" "half"
Texture "mixed" "spectrum" "mix" "texture tex1" "scaled" "rgb tex2" [ 1 1 1 ] "float amount" 0.25
Texture "ramp" "float" "bilerp" "float v00" 0 "float v01" 0 "float v10" 1 "float v11" 1
Material "matte" "texture Kd" "mixed" "texture sigma" "ramp"
Shape "sphere"
"#;
    let study = load_text(text);
    let base = study.study.scene.materials[0].diffuse().unwrap();
    let at = |u: f32, v: f32, nm: f64| {
        let uv = glam::Vec2::new(u, v);
        base.reflectance.iter().map(|term| term.spectrum.at(nm) * f64::from(term.weight.at(uv))).sum::<f64>()
    };
    // 650 nm is all red, 450 nm all blue.
    for (u, v, nm, expected) in [
        (0.1, 0.1, 650.0, 0.75 * 0.5 * 0.8 + 0.25),
        (0.3, 0.1, 650.0, 0.25),
        (0.3, 0.1, 450.0, 0.75 * 0.5 * 0.5 + 0.25),
        (0.3, 0.6, 650.0, 0.75 * 0.5 * 0.8 + 0.25),
    ] {
        assert!((at(u, v, nm) - expected).abs() < 1e-4, "{u} {v} {nm}: {} {expected}", at(u, v, nm));
    }
}

/// Objects, nests of attributes and instances, as ISET3d for pbrt-v4 writes them.
const ISET_GEOMETRY: &[u8] = br#"
# Exported by piGeometryWrite
ObjectBegin "001_tooth_O"
  AttributeBegin
    NamedMaterial "tooth"
    Shape "plymesh" "string filename" "geometry/tooth.ply"
  AttributeEnd
ObjectEnd

AttributeBegin
#ObjectName 1_mouth_B #Dimension:[2.000000 2.000000 2.000000]
  ActiveTransform All
  Translate 0.000000 0.500000 0.000000
  Rotate 0.000000 0.000000 0.000000 1.000000
  Rotate 10.000000 0.000000 1.000000 0.000000
  Scale 1.000000 1.000000 1.000000
  AttributeBegin
    Transform [ 1 0 0 0 0 1 0 0 0 0 1 0 0 -0.5 1 1 ]
    MediumInterface "" "water"
    NamedMaterial "floor"
    Include "geometry/plane.pbrt"
    AttributeBegin
      Translate 0.4 0 -0.5
      NamedMaterial "tongue"
      Shape "sphere" "float radius" [0.300000]
    AttributeEnd
  AttributeEnd
  ObjectInstance "001_tooth_O"
AttributeEnd
AttributeBegin
  ConcatTransform [0.3 0 0 0 0 0.3 0 0 0 0 0.3 0 -0.6 0 0 1]
  ObjectInstance "001_tooth_O"
AttributeEnd
"#;

#[test]
fn a_scene_as_iset3d_writes_it_for_version_4() {
    let main = br#"
# Exported by piWrite v4 on computer on a day
Scale -1.000000 1.000000 1.000000
LookAt 0.000000 0.000000 -6.000000 0.000000 0.000000 0.000000 0.000000 1.000000 0.000000
Camera "perspective"
  "float fov" [30.000000]
  "float lensradius" [0.000000]
Sampler "halton"
  "integer pixelsamples" [8]
Integrator "volpath"
  "integer maxdepth" [4]
PixelFilter "gaussian"
  "float xradius" [1.500000]
  "float yradius" [1.500000]
Film "gbuffer"
  "integer xresolution" [8]
  "integer yresolution" [6]
  "string filename" ["renderings/mouth.exr"]
  "float diagonal" [35]

WorldBegin

MakeNamedMedium "water"
  "string type" "homogeneous" "spectrum sigma_a" [400 0.01 700 0.2] "spectrum sigma_s" [400 0.1 700 0.1]
Include "mouth_materials.pbrt"
Include "mouth_geometry.pbrt"
Include "mouth_lights.pbrt"
"#;
    let materials = br#"
# Exported by piMaterialWrite
Texture "checks" "spectrum" "checkerboard" "float uscale" [8] "float vscale" [8] "rgb tex1" [0.1 0.1 0.1] "rgb tex2" [0.9 0.9 0.9]
Texture "photo" "spectrum" "imagemap" "string filename" "textures/photo.pfm" "string filter" "bilinear" "bool invert" "false"
MakeNamedMaterial "floor" "string type" "diffuse" "texture reflectance" "checks"
MakeNamedMaterial "face" "string type" "diffuse" "texture reflectance" "photo"
MakeNamedMaterial "tooth" "string type" "coateddiffuse" "spectrum reflectance" [ 400 0.4 550 0.7 700 0.75 ]
  "float roughness" [ 0.05 ] "spectrum eta" "glass-BK7"
MakeNamedMaterial "tongue" "string type" "mix" "string materials" [ "face" "tooth" ] "float amount" [ 0.3 ]
"#;
    let lights = br#"
# Exported by piLightWrite
AttributeBegin
  Rotate -90 1 0 0
  LightSource "infinite" "spectrum L" "spds/lights/lamp.spd" "float scale" [0.100000]
AttributeEnd
AttributeBegin
  Translate 0 2 -2
  Rotate 90 1 0 0
  AreaLightSource "diffuse" "spectrum L" "spds/lights/lamp.spd" "float scale" [5.0] "bool twosided" "false" "float spread" [30.0]
  Shape "disk" "float radius" [0.5]
AttributeEnd
"#;
    let plane = br#"
Shape "trianglemesh"
  "integer indices" [ 0 1 2 0 2 3 ]
  "point3 P" [ -2 -1 1  2 -1 1  2 1 1  -2 1 1 ]
  "normal N" [ 0 0 -1 0 0 -1 0 0 -1 0 0 -1 ]
  "point2 uv" [ 0 0 1 0 1 1 0 1 ]
"#;
    let files: [(&str, &[u8]); 8] = [
        ("mouth.pbrt", main),
        ("mouth_materials.pbrt", materials),
        ("mouth_geometry.pbrt", ISET_GEOMETRY),
        ("mouth_lights.pbrt", lights),
        ("geometry/plane.pbrt", plane),
        ("geometry/tooth.ply", PLY.as_bytes()),
        ("textures/photo.pfm", &image()),
        ("spds/lights/lamp.spd", b"300 0\n400 1\n700 2\n800 2\n"),
    ];
    let study = load_files(&files, &PbrtOptions { unit_m: 0.01, ..PbrtOptions::default() }).unwrap();
    let scene = &study.study.scene;
    assert_eq!((scene.camera.width, scene.camera.height, scene.lights.len()), (8, 6, 1));
    assert_eq!((study.study.render.samples_per_pixel, study.study.render.max_depth), (8, 4));
    // The tooth twice, the plane, the tongue and the lamp.
    let many = scene.objects.iter().find_map(|object| match &object.shape {
        Shape::Instances(many) => Some(many.instances.len()),
        _ => None,
    });
    assert_eq!((scene.objects.len(), many), (4, Some(2)));
    let lamp = scene.objects.iter().find(|object| object.emission.is_some()).unwrap();
    assert!(lamp.emission.as_ref().is_some_and(|emission| emission.is_one_sided));
    let found = remarks(&study);
    for text in ["participating media", "\"spread\" has no counterpart", "its index is 1.5168"] {
        assert!(found.iter().any(|remark| remark.contains(text)), "{text}: {found:?}");
    }
    let image = rendered(&study, 16, 30);
    assert!(image.mean.iter().all(|value| value.is_finite() && *value > 0.0));
}

/// What `pbrt --upgrade` and `--format` write: every number with six digits, options by name, lists in brackets over several lines.
#[test]
fn a_scene_as_pbrt_itself_writes_it() {
    let text = r#"
Option "disablepixeljitter" true
Option "rendercoordsys" "world"
Option "seed" 7
Option "force-diffuse" true
Option "stereo" 1
LookAt 0.000000 0.000000 5.000000
    0.000000 0.000000 0.000000
    0.000000 1.000000 0.000000
Camera "perspective"
    "float fov" [ 45 ]
Sampler "independent"
Film "rgb"
    "integer yresolution" [ 4 ]
    "integer xresolution" [ 4 ]
    "string filename" [ "a.exr" ]
Integrator "path"

WorldBegin

AttributeBegin
    AreaLightSource "diffuse"
        "rgb L" [ 10 10 10 ]
    Translate 0.000000 0.000000 9.000000
    ReverseOrientation
    Shape "disk"
        "float radius" [ 3 ]
AttributeEnd

Attribute "shape" "float alpha" [ 1 ]
MakeNamedMaterial "a"
    "string type" [ "diffuse" ]
    "rgb reflectance" [ 0.5 0.5 0.5 ]
AttributeBegin
    NamedMaterial "a"
    ReverseOrientation
    Shape "trianglemesh"
        "point2 uv" [ 0 0 1 0 1 1
            0 1 ]
        "normal N" [ 0 0 1 0 0 1
            0 0 1 0 0 1 ]
        "point3 P" [ -1 -1 0 1 -1 0
            1 1 0 -1 1 0 ]
        "integer indices" [ 0 1 2 0
            2 3 ]
AttributeEnd
"#;
    let study = load_text(text);
    assert_eq!((study.study.render.seed, study.study.render.samples_per_pixel), (7, 4));
    let found = remarks(&study);
    let named = |part: &str| found.iter().filter(|text| text.contains(part)).count();
    assert_eq!(
        [named("force-diffuse"), named("\"stereo\" is not known"), named("disablepixeljitter")],
        [1, 1, 0]
    );
    assert!(rendered(&study, 4, 30).mean[30] > 0.0);
}

/// What obj2pbrt of version 3 writes.
#[test]
fn a_scene_as_obj2pbrt_writes_it() {
    let text = r#"
# Converted from "jaw.obj" by obj2pbrt
# Scene bounds: (-1.000000, -1.000000, 0.000000) - (1.000000, 1.000000, 0.000000)

LookAt 0 0 4  0 0 0  0 1 0
Camera "perspective" "float fov" [45]
Film "image" "integer xresolution" [4] "integer yresolution" [4]
Integrator "directlighting"
WorldBegin

MakeNamedMaterial "enamel" "string type" "uber" "color Kd" [0.640000 0.630000 0.600000] "color Ks" [0.040000 0.040000 0.040000] "float roughness" [0.010000] "float index" [1.620000] "color opacity" [1.000000 1.000000 1.000000]

# Name "tooth"
AttributeBegin
NamedMaterial "enamel"
Shape "trianglemesh"
  "point3 P" [
	-1 -1 0
	1 -1 0
	1 1 0
]
  "normal N" [
	0 0 1
	0 0 1
	0 0 1
]
  "point2 st" [
	0 0
	1 0
	1 1
]
  "integer indices" [
	0 1 2
	]
  "integer faceIndices" [
	0
]

AttributeEnd


# Name "lamp"
AttributeBegin
AreaLightSource "area" "rgb L" [ 5.000000 5.000000 5.000000 ]
Translate 0 0 6
ReverseOrientation
Shape "disk" "float radius" 2
AttributeEnd
WorldEnd
"#;
    let study = load_text(text);
    let scene = &study.study.scene;
    assert_eq!((scene.objects.len(), scene.materials[scene.objects[0].material].coat().is_some()), (2, true));
    assert!(remarks(&study).iter().any(|text| text.contains("Integrator \"directlighting\": all light")));
    assert!(rendered(&study, 16, 30).mean[30] > 0.0);
}

/// Scenes of the public collections brighten images by factors above 1; pbrt cuts the product there.
#[test]
fn textures_brighter_than_white_are_cut() {
    let text = br#"
Camera "perspective" WorldBegin LightSource "infinite"
Texture "photo" "spectrum" "imagemap" "string filename" [ "photo.pfm" ] "string encoding" [ "linear" ]
Texture "bright" "spectrum" "scale" "float scale" [ 3 ] "texture tex" [ "photo" ]
MakeNamedMaterial "a" "string type" [ "diffuse" ] "texture reflectance" [ "bright" ]
MakeNamedMaterial "b" "string type" [ "coateddiffuse" ] "texture reflectance" [ "bright" ] "float roughness" [ 0.01 ]
Translate 0 0 4 NamedMaterial "a" Shape "sphere" NamedMaterial "b" Translate 3 0 0 Shape "sphere"
"#;
    let files: [(&str, &[u8]); 2] = [("s.pbrt", text), ("photo.pfm", &image())];
    let study = load_files(&files, &PbrtOptions::default()).unwrap();
    assert!(remarks(&study).iter().any(|text| text.contains("outside of 0 to 1 and is cut there")));
    let base = study.study.scene.materials[0].diffuse().unwrap();
    let at = |nm: f64| {
        let uv = glam::Vec2::new(0.75, 0.5);
        base.reflectance.iter().map(|term| term.spectrum.at(nm) * f64::from(term.weight.at(uv))).sum::<f64>()
    };
    // Three times 0.5, 0.25 and 0.125: red is cut at 1, green and blue stay.
    assert!(
        (at(650.0) - 1.0).abs() < 0.02 && (at(450.0) - 0.375).abs() < 0.02,
        "{} {}",
        at(650.0),
        at(450.0)
    );
    assert!(study.study.scene.check().is_ok());
}

/// Parts of scenes, of which others are lit: all is there but light.
#[test]
fn a_scene_without_lights_is_read_and_says_so() {
    let study = load_text("WorldBegin\nMaterial \"matte\"\nShape \"sphere\"\nShape \"disk\"");
    assert_eq!((study.study.scene.objects.len(), study.study.scene.lights.len()), (2, 0));
    let text = "the scene has no lights; add a LightSource, or an AreaLightSource before a Shape";
    assert_eq!(remarks(&study), [text]);
    assert!(study.messages[0].contains("s.pbrt:3:1: "), "{:?}", study.messages);
    assert_eq!(check_light(&study.study.scene), Err(text));
    let lit = load_text("AreaLightSource \"diffuse\"\nShape \"sphere\"");
    assert!(check_light(&lit.study.scene).is_ok() && remarks(&lit).is_empty());
}

#[test]
fn meshes_without_triangles_and_faces_without_corners_are_left_out() {
    let ply = PLY.replace("element face 1", "element face 2").replace("4 0 1 2 3", "0\n4 0 1 2 3");
    let empty = PLY.replace("element face 1", "element face 0").replace("4 0 1 2 3\n", "");
    let main = br#"LightSource "infinite"
Shape "trianglemesh" "point P" [] "integer indices" []
Shape "plymesh" "string filename" "empty.ply"
Shape "plymesh" "string filename" "m.ply"
"#;
    let files: [(&str, &[u8]); 3] =
        [("s.pbrt", main), ("m.ply", ply.as_bytes()), ("empty.ply", empty.as_bytes())];
    let study = load_files(&files, &PbrtOptions::default()).unwrap();
    let [object] = &study.study.scene.objects[..] else { panic!() };
    let Shape::Mesh(mesh) = &object.shape else { panic!() };
    assert_eq!(mesh.triangles.len(), 2);
    let none = "the mesh has no triangles and is left out";
    assert_eq!(remarks(&study), [none, none, "face 0 has 0 corners and is left out"]);
}

/// Silicon, diamond: Fresnel's equations hold for all. At normal incidence ((3.5 - 1) / (3.5 + 1))² = 0.3086 comes back.
#[test]
fn bodies_of_high_index_are_read() {
    let text = "LookAt 0 0 3  0 0 0  0 1 0\nCamera \"perspective\" \"float fov\" 0.1\nIntegrator \"path\" \"integer maxdepth\" 1\n\
        Film \"image\" \"integer xresolution\" 1 \"integer yresolution\" 1\nWorldBegin\nLightSource \"infinite\" \"rgb L\" [1 1 1]\n\
        Material \"glass\" \"float eta\" 3.5 \"rgb Kt\" [0 0 0]\nShape \"sphere\"";
    let image = rendered(&load_text(text), 4096, 40);
    // A binomial share of 4096 samples: standard error 0.0072.
    assert!((image.mean[40] - 0.3086).abs() < 0.03, "{}", image.mean[40]);
}

#[test]
fn a_mixture_takes_what_is_not_defined_as_matte_in_version_3() {
    let mix = "LightSource \"infinite\" MakeNamedMaterial \"a\" \"string type\" \"matte\"\n\
        Material \"mix\" \"string namedmaterial1\" \"a\" \"string namedmaterial2\" \"b\"\nShape \"sphere\"";
    let said = "\"b\" is taken as matte, as in pbrt-v3: no MakeNamedMaterial defines it";
    assert_eq!(remarks(&load_text(mix)), [said]);
    let version_4 = format!("ColorSpace \"srgb\" {mix}");
    let error = load_files(&[("s.pbrt", version_4.as_bytes())], &PbrtOptions::default()).unwrap_err();
    assert!(error.message.contains("no MakeNamedMaterial defines \"b\""), "{error}");
}
