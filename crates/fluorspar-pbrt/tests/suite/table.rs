//! The tables of docs/pbrt.md against the file formats of pbrt-v3 and v4 and against the reader: every directive, class and parameter of
//! the public pages stands in the tables, and what the reader leaves out the tables call so.

use std::fs;
use std::path::Path;

use fluorspar_pbrt::{PbrtOptions, PbrtStudy, load};

/// Parameters of a class, as they are declared: `float fov`, or with a value `string filename=m.ply`.
type Class = (&'static str, &'static str, &'static str);

/// <https://pbrt.org/fileformat-v3> and <https://pbrt.org/fileformat-v4>, parameters of both versions together, checked against what the
/// sources of pbrt-v3 (13d871f), pbrt-v4 (5f7a606) and pbrt-v3-spectral (c4d605a) look up.
const CLASSES: &[Class] = &[
    (
        "Camera",
        "perspective",
        "float frameaspectratio=1.5, float screenwindow=-1 1 -1 1, float lensradius, float focaldistance, float fov, float halffov, float shutteropen, float shutterclose",
    ),
    (
        "Camera",
        "orthographic",
        "float frameaspectratio=1.5, float screenwindow=-1 1 -1 1, float lensradius, float focaldistance",
    ),
    (
        "Film",
        "rgb",
        "integer xresolution, integer yresolution, float cropwindow=0 1 0 1, integer pixelbounds=0 1 0 1, float diagonal, string filename, bool savefp16, float iso, float whitebalance, string sensor, float maxcomponentvalue, float exposuretime",
    ),
    ("Film", "gbuffer", "string coordinatesystem"),
    ("Film", "spectral", "integer nbuckets, float lambdamin, float lambdamax"),
    ("Film", "image", "float scale, float maxsampleluminance, bool spectralFlag"),
    (
        "Sampler",
        "stratified",
        "integer pixelsamples, integer xsamples, integer ysamples, integer seed, bool jitter, integer dimensions",
    ),
    ("Sampler", "halton", "integer pixelsamples, bool samplepixelcenter, string randomization"),
    ("Sampler", "sobol", ""),
    ("Sampler", "paddedsobol", ""),
    ("Sampler", "zsobol", ""),
    ("Sampler", "pmj02bn", ""),
    ("Sampler", "independent", ""),
    ("Sampler", "random", ""),
    ("Sampler", "maxmindist", ""),
    ("Sampler", "02sequence", ""),
    ("Sampler", "lowdiscrepancy", ""),
    (
        "Integrator",
        "path",
        "integer maxdepth, float rrthreshold, string lightsamplestrategy, string lightsampler, bool regularize, integer pixelbounds=0 1 0 1",
    ),
    ("Integrator", "volpath", ""),
    ("Integrator", "bdpt", "bool visualizestrategies, bool visualizeweights"),
    (
        "Integrator",
        "mlt",
        "integer bootstrapsamples, integer chains, integer mutationsperpixel, float largestepprobability, float sigma",
    ),
    (
        "Integrator",
        "sppm",
        "float radius, integer photonsperiteration, integer iterations, integer numiterations, integer imagewritefrequency, integer seed",
    ),
    ("Integrator", "simplepath", "bool samplebsdf, bool samplelights"),
    ("Integrator", "simplevolpath", ""),
    ("Integrator", "lightpath", ""),
    ("Integrator", "randomwalk", ""),
    ("Integrator", "spectralpath", "integer numCABands"),
    ("Integrator", "directlighting", "string strategy"),
    ("Integrator", "whitted", ""),
    ("Integrator", "ao", "bool cossample, integer nsamples"),
    ("Integrator", "ambientocclusion", "float maxdistance"),
    ("Integrator", "function", "string function, string imagefilename, bool skipbad"),
    ("PixelFilter", "box", "float xwidth, float ywidth, float xradius, float yradius"),
    ("PixelFilter", "gaussian", "float alpha, float sigma"),
    ("PixelFilter", "mitchell", "float B, float C"),
    ("PixelFilter", "sinc", "float tau"),
    ("PixelFilter", "triangle", ""),
    ("Accelerator", "bvh", "integer maxnodeprims, string splitmethod"),
    (
        "Accelerator",
        "kdtree",
        "integer intersectcost, integer traversalcost, float emptybonus, integer maxprims, integer maxdepth",
    ),
    (
        "MakeNamedMedium",
        "m",
        "string type=homogeneous, spectrum sigma_a=400 1 700 1, spectrum sigma_s=400 1 700 1, float scale, float g, string preset",
    ),
    (
        "MakeNamedMedium",
        "n",
        "string type=uniformgrid, float density, point3 p0=0 0 0, point3 p1=1 1 1, integer nx, integer ny, integer nz, spectrum Le=400 1 700 1, float Lescale, float temperature, float temperaturecutoff, float temperatureoffset, float temperaturescale",
    ),
    (
        "MakeNamedMedium",
        "o",
        "string type=nanovdb, string filename, string gridname, string temperaturename, float frequency, float wispiness",
    ),
    (
        "Shape",
        "trianglemesh",
        "integer indices=0 1 2, point3 P=0 0 0 1 0 0 0 1 0, normal N=0 0 1 0 0 1 0 0 1, vector3 S=1 0 0 1 0 0 1 0 0, point2 uv=0 0 1 0 0 1, integer faceIndices=0, float alpha=1",
    ),
    ("Shape", "plymesh", "string filename=m.ply, texture displacement=f, float edgelength, float alpha=1"),
    (
        "Shape",
        "bilinearmesh",
        "integer indices=0 1 2 3, point3 P=0 0 0 1 0 0 0 1 0 1 1 0, normal N=0 0 1 0 0 1 0 0 1 0 0 1, point2 uv=0 0 1 0 0 1 1 1, string emissionfilename",
    ),
    (
        "Shape",
        "loopsubdiv",
        "integer indices=0 1 2, point3 P=0 0 0 1 0 0 0 1 0, integer levels, integer nlevels, string scheme",
    ),
    ("Shape", "sphere", "float radius=1, float zmin=-1, float zmax=1, float phimax=360"),
    ("Shape", "disk", "float height, float radius, float innerradius=0.1, float phimax=360"),
    ("Shape", "cylinder", "float radius, float zmin=0, float zmax=1, float phimax=360"),
    ("Shape", "cone", "float radius, float height, float phimax=360"),
    ("Shape", "paraboloid", "float radius, float zmin=0, float zmax=1, float phimax=360"),
    (
        "Shape",
        "curve",
        "point3 P=0 0 0 1 0 0 0 1 0 1 1 1, normal N=0 0 1 0 0 1, string type=flat, string basis=bezier, integer degree=3, float width, float width0, float width1, integer splitdepth",
    ),
    ("Shape", "hyperboloid", "point3 p1=0 0 0, point3 p2=1 1 1, float phimax=360"),
    ("Shape", "heightfield", "integer nu, integer nv, float Pz=0 0 0 0"),
    (
        "Shape",
        "nurbs",
        "integer nu, integer nv, integer uorder, integer vorder, float uknots=0 1, float vknots=0 1, float u0, float u1, float v0, float v1, float Pw=0 0 0 1, point3 P=0 0 0",
    ),
    ("Material", "matte", "rgb Kd=0.5 0.5 0.5, float sigma, texture bumpmap=f"),
    ("Material", "diffuse", "rgb reflectance=0.5 0.5 0.5, texture displacement=f, string normalmap=n.png"),
    ("Material", "plastic", "rgb Kd=0.5 0.5 0.5, rgb Ks=0.5 0.5 0.5, float roughness, bool remaproughness"),
    (
        "Material",
        "substrate",
        "rgb Kd=0.5 0.5 0.5, rgb Ks=0.5 0.5 0.5, float uroughness, float vroughness, bool remaproughness",
    ),
    (
        "Material",
        "uber",
        "rgb Kd=0.5 0.5 0.5, rgb Ks=0.5 0.5 0.5, rgb Kr=0 0 0, rgb Kt=0 0 0, float roughness, float uroughness, float vroughness, float eta=1.5, float index=1.5, rgb opacity=1 1 1, bool remaproughness",
    ),
    (
        "Material",
        "coateddiffuse",
        "rgb reflectance=0.5 0.5 0.5, float roughness, float uroughness, float vroughness, bool remaproughness, float thickness, float eta=1.5, float g, rgb albedo=0 0 0, integer maxdepth, integer nsamples",
    ),
    (
        "Material",
        "coatedconductor",
        "float conductor.uroughness, float conductor.vroughness, float interface.uroughness, float interface.vroughness, float interface.roughness, float thickness, float interface.eta=1.5, float g, rgb albedo=0 0 0, integer maxdepth, integer nsamples, spectrum conductor.eta=\"metal-Ag-eta\", spectrum conductor.k=\"metal-Ag-k\", float conductor.roughness, bool remaproughness",
    ),
    (
        "Material",
        "metal",
        "spectrum eta=\"metal-Cu-eta\", spectrum k=\"metal-Cu-k\", float roughness, float uroughness, float vroughness, bool remaproughness",
    ),
    (
        "Material",
        "conductor",
        "spectrum eta=\"metal-Al-eta\", spectrum k=\"metal-Al-k\", float roughness, bool remaproughness",
    ),
    (
        "Material",
        "glass",
        "rgb Kr=1 1 1, rgb Kt=1 1 1, float eta=1.5, float index=1.5, float uroughness, float vroughness, bool remaproughness",
    ),
    (
        "Material",
        "dielectric",
        "float eta=1.5, float roughness, float uroughness, float vroughness, bool remaproughness",
    ),
    ("Material", "thindielectric", "float eta=1.5"),
    ("Material", "mirror", "rgb Kr=0.9 0.9 0.9"),
    ("Material", "interface", ""),
    (
        "Material",
        "translucent",
        "rgb Kd=0.2 0.2 0.2, rgb Ks=0.2 0.2 0.2, rgb reflect=0.5 0.5 0.5, rgb transmit=0.5 0.5 0.5, float roughness",
    ),
    (
        "Material",
        "kdsubsurface",
        "rgb Kd=0.2 0.2 0.2, rgb Kr=1 1 1, rgb Kt=1 1 1, rgb mfp=1 1 1, float g, float scale, float eta=1.3",
    ),
    (
        "Material",
        "subsurface",
        "rgb sigma_a=1 1 1, rgb sigma_s=1 1 1, string name, rgb reflectance=0.2 0.2 0.2",
    ),
    (
        "Material",
        "disney",
        "rgb color=0.2 0.2 0.2, bool thin, float anisotropic, float clearcoat, float clearcoatgloss, float difftrans, float eta=1.5, float flatness, float metallic, float roughness, rgb scatterdistance=0 0 0, float sheen, float sheentint, float spectrans, float speculartint",
    ),
    (
        "Material",
        "diffusetransmission",
        "rgb reflectance=0.2 0.2 0.2, rgb transmittance=0.2 0.2 0.2, float scale",
    ),
    ("Material", "measured", "string filename"),
    ("Material", "fourier", "string bsdffile"),
    (
        "Material",
        "hair",
        "rgb color=0.2 0.2 0.2, rgb sigma_a=1 1 1, float eumelanin, float pheomelanin, float eta=1.5, float alpha, float beta_m, float beta_n",
    ),
    ("LightSource", "point", "rgb I=1 1 1, point3 from=0 0 5, float scale, float power"),
    (
        "LightSource",
        "spot",
        "rgb I=1 1 1, point3 from=0 0 5, point3 to=0 0 0, float coneangle=30, float conedeltaangle=5, float scale, float power",
    ),
    (
        "LightSource",
        "distant",
        "rgb L=1 1 1, point3 from=0 0 5, point3 to=0 0 0, float scale, float illuminance",
    ),
    (
        "LightSource",
        "infinite",
        "rgb L=1 1 1, float scale, float illuminance, integer samples, integer nsamples, point3 portal=0 0 0 1 0 0 1 1 0 0 1 0",
    ),
    ("LightSource", "goniometric", "rgb I=1 1 1, string mapname, string filename, float scale, float power"),
    (
        "LightSource",
        "projection",
        "rgb I=1 1 1, string mapname, string filename, float fov, float scale, float power",
    ),
    ("AreaLightSource", "diffuse", "rgb L=1 1 1, bool twosided, float scale, float power"),
];

/// Directives of both versions.
const DIRECTIVES: &[&str] = &[
    "Include",
    "Import",
    "Identity",
    "Translate",
    "Scale",
    "Rotate",
    "LookAt",
    "Transform",
    "ConcatTransform",
    "CoordinateSystem",
    "CoordSysTransform",
    "ActiveTransform",
    "TransformTimes",
    "TransformBegin",
    "TransformEnd",
    "AttributeBegin",
    "AttributeEnd",
    "Attribute",
    "ReverseOrientation",
    "WorldBegin",
    "WorldEnd",
    "ObjectBegin",
    "ObjectEnd",
    "ObjectInstance",
    "Camera",
    "Film",
    "Sampler",
    "Integrator",
    "SurfaceIntegrator",
    "VolumeIntegrator",
    "PixelFilter",
    "Accelerator",
    "Renderer",
    "Option",
    "ColorSpace",
    "Shape",
    "Material",
    "MakeNamedMaterial",
    "NamedMaterial",
    "Texture",
    "LightSource",
    "AreaLightSource",
    "MakeNamedMedium",
    "MediumInterface",
    "Volume",
];

/// Options of version 4.
const OPTIONS: &[&str] = &[
    "disablepixeljitter",
    "disabletexturefiltering",
    "disablewavelengthjitter",
    "displacementedgescale",
    "forcediffuse",
    "msereferenceimage",
    "msereferenceout",
    "pixelstats",
    "rendercoordsys",
    "seed",
    "wavefront",
];

/// Parameters of textures.
const TEXTURE_PARAMETERS: &[&str] = &[
    "value",
    "tex",
    "tex1",
    "tex2",
    "amount",
    "scale",
    "filename",
    "invert",
    "gamma",
    "encoding",
    "wrap",
    "filter",
    "maxanisotropy",
    "trilinear",
    "noFiltering",
    "useSPD",
    "aamode",
    "dimension",
    "dir",
    "mapping",
    "uscale",
    "vscale",
    "udelta",
    "vdelta",
    "v1",
    "v2",
    "v00",
    "v01",
    "v10",
    "v11",
    "inside",
    "outside",
    "octaves",
    "roughness",
    "variation",
];

/// Textures; their parameters stand in one table.
const TEXTURES: &[&str] = &[
    "constant",
    "scale",
    "mix",
    "checkerboard",
    "imagemap",
    "bilerp",
    "directionmix",
    "uv",
    "dots",
    "fbm",
    "wrinkled",
    "windy",
    "marble",
    "ptex",
];

fn documentation() -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/pbrt.md")).unwrap()
}

/// Rows of tables that name something in backquotes.
fn rows<'a>(text: &'a str, name: &str) -> Vec<&'a str> {
    let quoted = format!("`{name}`");
    text.lines().filter(|line| line.starts_with('|') && line.contains(&quoted)).collect()
}

/// A scene with one directive and all of its parameters.
fn scene((directive, class, parameters): &Class) -> String {
    let mut line = format!("{directive} \"{class}\"");
    for parameter in parameters.split(", ").filter(|parameter| !parameter.is_empty()) {
        let (declared, value) = parameter.split_once('=').unwrap_or_else(|| {
            let usual = match parameter.split(' ').next() {
                Some("bool") => "true",
                Some("string") => "\"x\"",
                Some("integer") => "2",
                _ => "0.5",
            };
            (parameter, usual)
        });
        let is_text = declared.starts_with("string") || declared.starts_with("texture");
        let value = if is_text && !value.starts_with('"') { format!("\"{value}\"") } else { value.into() };
        line.push_str(&format!(" \"{declared}\" [ {value} ]"));
    }
    let is_before =
        ["Camera", "Film", "Sampler", "Integrator", "PixelFilter", "Accelerator"].contains(directive);
    let (before, after) = if is_before { (line.as_str(), "") } else { ("", line.as_str()) };
    let film = if *directive == "Film" {
        ""
    } else {
        "Film \"image\" \"integer xresolution\" 4 \"integer yresolution\" 4\n"
    };
    format!(
        "{before}\n{film}WorldBegin\nTexture \"f\" \"float\" \"constant\" \"float value\" 0.5\nLightSource \"infinite\"\n\
         Shape \"disk\" \"float radius\" 1\n{after}\nShape \"disk\" \"float radius\" 3\n"
    )
}

fn loaded(class: &Class) -> PbrtStudy {
    let folder = tempfile::tempdir().unwrap();
    let mesh = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
                property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    fs::write(folder.path().join("m.ply"), mesh).unwrap();
    fluorspar_format::write_rgb_png(&folder.path().join("n.png"), 2, 2, &[127, 127, 255].repeat(4)).unwrap();
    fs::write(folder.path().join("s.pbrt"), scene(class)).unwrap();
    let options = PbrtOptions::default();
    load(&folder.path().join("s.pbrt"), &options).unwrap_or_else(|error| panic!("{class:?}: {error}"))
}

#[test]
fn everything_that_pbrt_reads_stands_in_the_tables() {
    let text = documentation();
    let names = DIRECTIVES.iter().chain(TEXTURES).chain(TEXTURE_PARAMETERS).chain(OPTIONS).copied();
    let classes = CLASSES
        .iter()
        .filter(|(directive, ..)| !["Film", "MakeNamedMedium"].contains(directive))
        .map(|(_, class, _)| *class);
    let parameters = CLASSES
        .iter()
        .flat_map(|(_, _, parameters)| parameters.split(", "))
        .filter_map(|parameter| parameter.split(['=']).next()?.split(' ').nth(1));
    let missing: Vec<&str> =
        names.chain(classes).chain(parameters).filter(|name| rows(&text, name).is_empty()).collect();
    // Parts of a name that belongs to a coat stand in words.
    let missing: Vec<&str> =
        missing.into_iter().filter(|name| !text.contains(&format!("`{name}`"))).collect();
    assert!(missing.is_empty(), "docs/pbrt.md lacks {missing:?}");
}

#[test]
fn what_the_reader_leaves_out_the_tables_call_so() {
    let text = documentation();
    let mut wrong = Vec::new();
    for class in CLASSES {
        let study = loaded(class);
        for remark in
            study.remarks.iter().filter(|remark| remark.text.contains("has no counterpart and is left out"))
        {
            let quoted: Vec<&str> = remark.text.split('"').skip(1).step_by(2).collect();
            let name = quoted.last().copied().unwrap_or_default();
            let is_said = rows(&text, name)
                .iter()
                .any(|row| ["named", "without its coat", "near"].iter().any(|word| row.contains(word)));
            if !is_said {
                wrong.push(format!("{} {}: {}", class.0, class.1, remark.text));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
