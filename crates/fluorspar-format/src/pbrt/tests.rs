use std::fs;
use std::path::Path;

use glam::{DMat4, DVec3};

use super::*;

fn scene(text: &str) -> PbrtScene {
    read(text).unwrap()
}

fn read(text: &str) -> Result<PbrtScene, PbrtError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.pbrt");
    fs::write(&path, text).unwrap();
    read_pbrt(&path)
}

/// Place and message of an error.
fn refused(text: &str) -> String {
    let error = read(text).unwrap_err();
    let [line, column] = error.at.unwrap();
    format!("{line}:{column}: {}", error.message)
}

#[test]
fn parameters_have_types_names_and_values() {
    let scene = scene(
        "# a comment\nFilm \"image\" \"integer xresolution\" [ 40 ] \"float scale\" 2.5e-1 \"string filename\" \"a \\\"b\\\".exr\"\n\
         Sampler \"halton\" \"bool jitter\" [ false ]\nWorldBegin Shape \"sphere\"\"float radius\"2\"rgb Kd\"[.1 .2 .3]#end",
    );
    let film = scene.settings.film.unwrap();
    assert_eq!(
        (film.class.as_str(), film.number("xresolution"), film.number("scale")),
        ("image", Some(40.0), Some(0.25))
    );
    assert_eq!(film.text("filename"), Some("a \"b\".exr"));
    assert_eq!((film.at.line, film.at.column), (2, 1));
    assert_eq!(scene.settings.sampler.unwrap().flag("jitter"), Some(false));
    let shape = &scene.shapes[0].entity;
    assert_eq!((shape.number("radius"), shape.numbers("Kd")), (Some(2.0), Some([0.1, 0.2, 0.3].as_slice())));
}

#[test]
fn transforms_multiply_from_the_right_and_blocks_restore_them() {
    let scene = scene(
        "Scale -1 1 1\nLookAt 1 2 3  1 2 4  0 1 0\nCamera \"perspective\"\nWorldBegin\nAttributeBegin\nTranslate 1 0 0\n\
         Rotate 90 0 0 1\nScale 2 2 2\nCoordinateSystem \"here\"\nShape \"sphere\"\nReverseOrientation\n\
         ConcatTransform [1 0 0 0 0 1 0 0 0 0 1 0 5 6 7 1]\nShape \"disk\"\nAttributeEnd\nShape \"cone\"\n\
         TransformBegin CoordSysTransform \"here\" Shape \"sphere\" TransformEnd CoordSysTransform \"camera\" Shape \"sphere\"",
    );
    let at = |shape: usize, point: DVec3| scene.shapes[shape].to_world.transform_point3(point);
    assert!(at(0, DVec3::X).abs_diff_eq(DVec3::new(1.0, 2.0, 0.0), 1e-12));
    assert!(at(1, DVec3::ZERO).abs_diff_eq(DVec3::new(-11.0, 10.0, 14.0), 1e-12));
    assert!(scene.shapes[1].is_reversed && !scene.shapes[2].is_reversed);
    assert_eq!(scene.shapes[2].to_world, DMat4::IDENTITY);
    assert_eq!(scene.shapes[3].to_world, scene.shapes[0].to_world);
    // The camera stands at the eye and looks to +z; what is mirrored before it is its image.
    let camera = scene.settings.camera.as_ref().unwrap().to_world;
    assert!(camera.transform_point3(DVec3::ZERO).abs_diff_eq(DVec3::new(1.0, 2.0, 3.0), 1e-12));
    assert!(camera.transform_vector3(DVec3::Z).abs_diff_eq(DVec3::Z, 1e-12));
    assert!(camera.transform_vector3(DVec3::X).abs_diff_eq(DVec3::NEG_X, 1e-12));
    assert!(scene.shapes[4].to_world.abs_diff_eq(camera, 1e-12));
}

#[test]
fn materials_lights_and_textures_follow_the_attributes() {
    let scene = scene(
        "WorldBegin\nTexture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"a.png\"\n\
         MakeNamedMaterial \"m\" \"string type\" \"matte\" \"texture Kd\" \"t\"\nAttributeBegin\nNamedMaterial \"m\"\n\
         AreaLightSource \"diffuse\" \"rgb L\" [1 1 1]\nShape \"sphere\"\nAttributeEnd\nShape \"sphere\"\nMaterial \"glass\"\n\
         ObjectBegin \"o\" Shape \"disk\" ObjectEnd\nTranslate 0 0 1 ObjectInstance \"o\"\nWorldEnd",
    );
    assert_eq!(scene.version, PbrtVersion::V3);
    let [first, second, third] = &scene.shapes[..] else { panic!() };
    assert_eq!(
        (first.material, first.area_light, second.material, second.area_light),
        (Some(0), Some(0), None, None)
    );
    assert_eq!((third.material, third.object, scene.instances[0].object), (Some(1), Some(0), 0));
    assert_eq!(scene.materials[0].entity.find("Kd").unwrap().texture, [None, Some(0)]);
    assert!(scene.materials[0].entity.find("type").is_none());
}

#[test]
fn a_block_redefines_textures_and_materials_for_itself() {
    let texture =
        |nm: u32| format!("Texture \"t\" \"spectrum\" \"constant\" \"spectrum value\" [{nm} 1 800 1]\n");
    let material = |class: &str| format!("MakeNamedMaterial \"m\" \"string type\" \"{class}\"\n");
    let textured = "Material \"matte\" \"texture Kd\" \"t\" Shape \"sphere\"\n";
    let named = "NamedMaterial \"m\" Shape \"disk\"\n";
    let scene = scene(&format!(
        "WorldBegin\n{}{}AttributeBegin\nTransformBegin\n{}TransformEnd\n{}{textured}{named}AttributeEnd\n{textured}{named}WorldEnd",
        texture(300),
        material("matte"),
        texture(400),
        material("glass")
    ));
    let of = |shape: usize| scene.shapes[shape].material.unwrap();
    let texture_of = |shape: usize| scene.materials[of(shape)].entity.find("Kd").unwrap().texture[1];
    assert_eq!([texture_of(0), texture_of(2)], [Some(1), Some(0)]);
    assert_eq!([of(1), of(3)].map(|m| scene.materials[m].entity.class.as_str()), ["glass", "matte"]);
}

#[test]
fn version_4_gives_parameters_to_what_follows_and_names_later_materials() {
    let scene = scene(
        "ColorSpace \"srgb\" Option \"bool disablepixeljitter\" true\nWorldBegin\nAttributeBegin\nAttribute \"shape\" \"float radius\" 3\n\
         NamedMaterial \"later\" Shape \"sphere\" Shape \"sphere\" \"float radius\" 1\nAttributeEnd\nShape \"sphere\"\n\
         MakeNamedMaterial \"later\" \"string type\" \"diffuse\" \"texture reflectance\" \"t\"\n\
         Texture \"t\" \"spectrum\" \"constant\"\nMediumInterface \"\" \"fog\"",
    );
    let radius = |shape: usize| scene.shapes[shape].entity.number("radius");
    assert_eq!((radius(0), radius(1), radius(2)), (Some(3.0), Some(1.0), None));
    assert_eq!((scene.shapes[0].material, scene.shapes[2].material), (Some(0), None));
    assert_eq!(scene.materials[0].entity.parameters[0].texture, [None, Some(0)]);
    assert_eq!(scene.version, PbrtVersion::V4);
    let matter: Vec<bool> = scene.remarks.iter().map(|remark| remark.matters).collect();
    assert_eq!(matter, [false, true]);
}

#[test]
fn files_include_others_beside_them_but_never_themselves() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    fs::create_dir(folder.path().join("geo")).unwrap();
    write("s.pbrt", "WorldBegin Translate 1 0 0 Import \"geo/b.pbrt\" Include \"geo/a.pbrt\" Shape \"disk\"");
    write("geo/a.pbrt", "Include \"c.pbrt\" Include \"main.pbrt\"");
    write("geo/b.pbrt", "Translate 9 9 9");
    write("geo/c.pbrt", "Shape \"sphere\"");
    write("main.pbrt", "Translate 0 1 0");
    let scene = read_pbrt(&folder.path().join("s.pbrt")).unwrap();
    assert_eq!(scene.files.len(), 5);
    assert_eq!(scene.shapes[0].to_world.transform_point3(DVec3::ZERO), DVec3::X);
    assert_eq!(scene.shapes[1].to_world.transform_point3(DVec3::ZERO), DVec3::new(1.0, 1.0, 0.0));
    write("main.pbrt", "\n  Include \"./geo/a.pbrt\"");
    let error = read_pbrt(&folder.path().join("s.pbrt")).unwrap_err();
    assert_eq!((error.at, error.file.ends_with("main.pbrt")), (Some([2, 3]), true));
    assert!(error.message.ends_with("geo/a.pbrt includes itself; remove this line"), "{error}");
    write("main.pbrt", "Include \"none.pbrt\"");
    let error = read_pbrt(&folder.path().join("s.pbrt")).unwrap_err().to_string();
    assert!(error.contains("main.pbrt:1:1: ") && error.contains("none.pbrt: can't read it"), "{error}");
    assert!(
        read_pbrt(Path::new("/none/s.pbrt"))
            .unwrap_err()
            .to_string()
            .starts_with("/none/s.pbrt: can't read it")
    );
}

/// As both versions have it: the former is dropped, of colors and spectra whatever their type.
#[test]
fn of_a_parameter_that_is_given_twice_the_last_counts() {
    let scene = scene(
        "Integrator \"path\" \"integer maxdepth\" 1 \"integer maxdepth\" 5\nWorldBegin\n\
         LightSource \"point\" \"rgb I\" [1 2 3] \"float I\" 4 \"blackbody I\" 3000",
    );
    assert_eq!(scene.settings.integrator.as_ref().unwrap().number("maxdepth"), Some(5.0));
    let light = &scene.lights[0].entity;
    assert_eq!(
        light.parameters.iter().map(|p| p.kind).collect::<Vec<_>>(),
        [PbrtKind::Float, PbrtKind::Blackbody]
    );
    let remarks: Vec<_> = scene.remarks.iter().map(|r| (r.at.line, r.at.column, r.text.as_str())).collect();
    assert_eq!(
        remarks,
        [
            (1, 19, "parameter \"maxdepth\" is given twice: the last one counts"),
            (3, 21, "parameter \"I\" is given twice: the last one counts")
        ]
    );
}

/// Version 3 reads a number up to what is none.
#[test]
fn commas_behind_numbers_are_passed_over_with_a_remark() {
    let scene = scene("WorldBegin\nTranslate 1, -2, .5\nShape \"disk\" \"point P\" [3, 4., 5,]");
    assert_eq!(scene.shapes[0].to_world.transform_point3(DVec3::ZERO), DVec3::new(1.0, -2.0, 0.5));
    assert_eq!(scene.shapes[0].entity.numbers("P"), Some([3.0, 4.0, 5.0].as_slice()));
    let [remark] = &scene.remarks[..] else { panic!("{:?}", scene.remarks) };
    assert_eq!((remark.at.line, remark.at.column, remark.matters), (2, 11, true));
}

#[test]
fn a_material_that_is_not_defined_is_matte_in_version_3() {
    let scene =
        scene("MakeNamedMaterial \"gold\" \"string type\" \"metal\"\nNamedMaterial \"gild\" Shape \"disk\"");
    assert_eq!(scene.shapes[0].material, None);
    assert_eq!(
        (scene.remarks[0].at.line, scene.remarks[0].text.as_str()),
        (
            2,
            "\"gild\" is taken as matte, as in pbrt-v3: no MakeNamedMaterial defines it; did you mean \"gold\"?"
        )
    );
}

#[test]
fn mistakes_are_named_with_their_places() {
    for (text, expected) in [
        ("Shpae \"sphere\"", "1:1: Shpae is not a directive; did you mean \"Shape\"?"),
        ("\n Shape sphere", "2:2: this directive needs its type in quotes, for instance Shape \"sphere\""),
        (
            "Shape \"sphere\" \"flaot radius\" 1",
            "1:16: no parameter has the type \"flaot\"; did you mean \"float\"?",
        ),
        ("Shape \"sphere\" \"radius\" 1", "1:16: a parameter is declared with its type and its name"),
        ("Shape \"sphere\" \"float radius\" [ 1 x ]", "1:35: \"x\" is not a number"),
        ("Shape \"sphere\" \"float radius\" nan", "1:31: \"nan\" is not a number"),
        ("Shape \"sphere\" \"float radius\" \"1\"", "1:31: a number must stand here, not the text \"1\""),
        ("Shape \"sphere\" \"string a\" 1", "1:27: a text in quotes must stand here, not 1"),
        (
            "Shape \"m\" \"point P\" [ 1 2 3 4 ]",
            "1:11: \"point P\": 4 numbers can't be divided into values of 3",
        ),
        ("Shape \"m\" \"integer i\" 1.5", "1:11: \"integer i\": 1.5 is not a whole number"),
        ("Shape \"m\" \"spectrum L\" [ 1 2 3 ]", "1:11: \"spectrum L\": give pairs of wavelength"),
        ("Shape \"m\" \"float i\" [ 1", "1:11: this list of values is never closed; add ]"),
        ("Shape \"m\" \"float i\"", "1:11: parameter \"float i\" has no value"),
        ("Shape \"m\" \"float i\" 1,2", "1:21: \"1,2\" is not a number"),
        ("Shape, \"m\"", "1:1: Shape, is not a directive"),
        ("Shape \"m", "1:7: this text has no closing quote"),
        ("\"sphere\"", "1:1: a directive such as Shape must stand here"),
        ("Translate 1 2", "1:1: 3 numbers must follow this directive"),
        ("Rotate 1 0 0 0", "1:1: the axis of Rotate has no length"),
        ("LookAt 0 0 0 0 0 0 0 1 0", "1:1: LookAt looks at the place where it stands"),
        ("Scale 0 0 0 Camera \"perspective\"", "1:13: the transform of the camera has no inverse"),
        ("CoordSysTransform \"x\"", "1:1: no CoordinateSystem defines \"x\""),
        (
            "AttributeBegin\nTransformBegin\nAttributeEnd",
            "3:1: AttributeEnd closes the TransformBegin of line 2",
        ),
        ("AttributeEnd", "1:1: no AttributeBegin is open here"),
        ("ObjectBegin \"a\"\n", "1:1: ObjectBegin is never closed; add ObjectEnd"),
        ("ObjectInstance \"a\"", "1:1: no ObjectBegin defines \"a\""),
        (
            "ColorSpace \"srgb\" NamedMaterial \"a\" Shape \"sphere\"",
            "1:19: no MakeNamedMaterial defines \"a\"",
        ),
        ("MakeNamedMaterial \"a\" \"float Kd\" 1", "1:1: material \"a\" has no type"),
        ("Material \"matte\" \"texture Kd\" \"t\"", "1:18: no Texture defines \"t\""),
        ("Texture \"t\" \"foo\" \"constant\"", "1:1: a texture is of float or spectrum"),
        ("Attribute \"shap\" \"float a\" 1", "1:1: Attribute knows no \"shap\"; did you mean \"shape\"?"),
    ] {
        let said = refused(text);
        assert!(said.starts_with(expected), "{text}\n{said}\n{expected}");
    }
}

/// 22 files of 22 includes each, 22 + 22² + 22³ = 11 154 in all.
#[test]
fn many_includes_of_small_files_are_read() {
    let folder = tempfile::tempdir().unwrap();
    for level in 0..3 {
        let text = format!("Include \"{}.pbrt\"\n", level + 1).repeat(22);
        fs::write(folder.path().join(format!("{level}.pbrt")), text).unwrap();
    }
    fs::write(folder.path().join("3.pbrt"), "Translate 1 0 0\n").unwrap();
    fs::write(folder.path().join("s.pbrt"), "Include \"0.pbrt\" Shape \"sphere\"").unwrap();
    let scene = read_pbrt(&folder.path().join("s.pbrt")).unwrap();
    assert_eq!(scene.shapes[0].to_world.w_axis.x, 10_648.0);
    assert_eq!(scene.files.len(), 2 + 11_154);
}

/// Deep nesting, includes of includes of includes, endless lists: refused before they cost time or memory.
#[test]
fn hostile_files_are_refused_quickly() {
    let started = std::time::Instant::now();
    assert!(refused(&"AttributeBegin ".repeat(100_000)).contains("blocks within blocks are not read"));
    assert!(
        refused(&format!("Shape \"m\" \"float i\" {}", "[".repeat(1_000_000)))
            .contains("can't hold another one")
    );
    let many: String = (0..100_000).map(|i| format!("\"float a{i}\" 1 ")).collect();
    assert!(refused(&format!("Shape \"m\" {many}")).contains("more than 1000 parameters"));
    assert!(refused(&"x".repeat(1_000_000)).len() < 200);
    let folder = tempfile::tempdir().unwrap();
    for i in 0..31 {
        let next = format!("Include \"{0}.pbrt\" Include \"{0}.pbrt\"", i + 1);
        fs::write(folder.path().join(format!("{i}.pbrt")), next).unwrap();
    }
    fs::write(folder.path().join("31.pbrt"), "").unwrap();
    let error = read_pbrt(&folder.path().join("0.pbrt")).unwrap_err().to_string();
    assert!(error.contains("counted as often as it is included"), "{error}");
    assert!(started.elapsed().as_secs() < 20);
}
