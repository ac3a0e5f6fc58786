//! Typed parameters of directives: `"rgb reflectance" [ 0.8 0.7 0.6 ]`.

use super::error::{Fault, PbrtPlace};
use super::token::{Token, Tokens, number};
use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;

/// The type that a parameter is declared with. Names of older versions are read as those of today.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PbrtKind {
    /// `integer`, `int`.
    Integer,
    /// `float`.
    Float,
    /// `point2`.
    Point2,
    /// `vector2`.
    Vector2,
    /// `point3`, `point`.
    Point3,
    /// `vector3`, `vector`.
    Vector3,
    /// `normal3`, `normal`.
    Normal,
    /// `bool`.
    Bool,
    /// `string`.
    String,
    /// `texture`: the name of one.
    Texture,
    /// `rgb`, `color`.
    Rgb,
    /// `xyz`.
    Xyz,
    /// `spectrum`: wavelengths and values, or the name of a file or of a spectrum.
    Spectrum,
    /// `blackbody`: kelvins, in version 3 with a factor.
    Blackbody,
    /// `photolumi` of pbrt-v3-spectral: first wavelength, step, last wavelength, then a square matrix row by row.
    PhotoLumi,
}

/// Most parameters of a directive.
const MOST_PARAMETERS: usize = 1000;

const KINDS: &[(&str, PbrtKind)] = &[
    ("integer", PbrtKind::Integer),
    ("int", PbrtKind::Integer),
    ("float", PbrtKind::Float),
    ("point2", PbrtKind::Point2),
    ("vector2", PbrtKind::Vector2),
    ("point3", PbrtKind::Point3),
    ("point", PbrtKind::Point3),
    ("vector3", PbrtKind::Vector3),
    ("vector", PbrtKind::Vector3),
    ("normal3", PbrtKind::Normal),
    ("normal", PbrtKind::Normal),
    ("bool", PbrtKind::Bool),
    ("string", PbrtKind::String),
    ("texture", PbrtKind::Texture),
    ("rgb", PbrtKind::Rgb),
    ("color", PbrtKind::Rgb),
    ("xyz", PbrtKind::Xyz),
    ("spectrum", PbrtKind::Spectrum),
    ("blackbody", PbrtKind::Blackbody),
    ("photolumi", PbrtKind::PhotoLumi),
];

impl PbrtKind {
    /// Numbers of one value; `None` for values that are no fixed number of numbers.
    fn numbers_per_value(self) -> Option<usize> {
        match self {
            Self::Point2 | Self::Vector2 => Some(2),
            Self::Point3 | Self::Vector3 | Self::Normal | Self::Rgb | Self::Xyz => Some(3),
            Self::Integer | Self::Float => Some(1),
            _ => None,
        }
    }

    /// The kind that stands for all of which a name has one value: colors and spectra are one.
    fn group(self) -> Self {
        match self {
            Self::Rgb | Self::Xyz | Self::Blackbody => Self::Spectrum,
            other => other,
        }
    }

    /// Whether its values are texts.
    fn holds_texts(self) -> bool {
        matches!(self, Self::String | Self::Texture)
    }
}

/// Values of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum PbrtValues {
    /// Numbers, all those of a point or color after each other.
    Numbers(Vec<f64>),
    /// Texts: strings, and names of textures, files and spectra.
    Texts(Vec<String>),
    /// Truth values.
    Flags(Vec<bool>),
}

/// A parameter of a directive.
#[derive(Clone, Debug, PartialEq)]
pub struct PbrtParameter {
    /// Name, for instance "reflectance".
    pub name: String,
    /// Declared type.
    pub kind: PbrtKind,
    /// Values; exporters write empty lists of what a mesh does not have.
    pub values: PbrtValues,
    /// Where it is declared.
    pub at: PbrtPlace,
    /// Of a texture: the texture of numbers and the texture of spectra of that name, where there are such.
    pub texture: [Option<usize>; 2],
}

impl PbrtParameter {
    /// The numbers, if it has any.
    pub fn numbers(&self) -> Option<&[f64]> {
        match &self.values {
            PbrtValues::Numbers(values) => Some(values),
            _ => None,
        }
    }

    /// The texts, if it has any.
    pub fn texts(&self) -> Option<&[String]> {
        match &self.values {
            PbrtValues::Texts(values) => Some(values),
            _ => None,
        }
    }
}

/// Reads the parameters that follow a directive. `file` is the number of the file, `budget` the numbers that may still be
/// read, `replaced` takes those that a later one of their name and type replaces.
pub(super) fn parameters(
    tokens: &mut Tokens<'_>,
    file: u32,
    budget: &mut usize,
    replaced: &mut Vec<PbrtParameter>,
) -> Result<Vec<PbrtParameter>, Fault> {
    let mut list: Vec<PbrtParameter> = Vec::new();
    while let Some((Token::Text(_), _)) = tokens.peek()? {
        let Some((Token::Text(declaration), place)) = tokens.next()? else { break };
        let (kind, name) = declared(&declaration, place)?;
        if list.len() == MOST_PARAMETERS {
            let message =
                format!("a directive with more than {MOST_PARAMETERS} parameters is not read; split it");
            return Err(Fault::new(place, message));
        }
        let former = |other: &mut PbrtParameter| other.name == name && other.kind.group() == kind.group();
        replaced.extend(list.extract_if(.., former));
        let values = values(tokens, kind, &declaration, place, budget)?;
        let at = PbrtPlace { file, line: place[0], column: place[1] };
        list.push(PbrtParameter { name, kind, values, at, texture: [None; 2] });
    }
    Ok(list)
}

/// Type and name of a declaration such as `rgb reflectance`.
fn declared(declaration: &str, place: [u32; 2]) -> Result<(PbrtKind, String), Fault> {
    let mut words = declaration.split_ascii_whitespace();
    let (Some(kind), Some(name), None) = (words.next(), words.next(), words.next()) else {
        let message = format!(
            "a parameter is declared with its type and its name, for instance \"float fov\"; here stands \"{}\"",
            excerpt(declaration)
        );
        return Err(Fault::new(place, message));
    };
    match KINDS.iter().find(|(known, _)| *known == kind) {
        Some((_, kind)) => Ok((*kind, name.to_string())),
        None => {
            let hint = did_you_mean(kind, KINDS.iter().map(|(known, _)| *known));
            let message = format!("no parameter has the type \"{}\"{hint}", excerpt(kind));
            Err(Fault::new(place, message))
        }
    }
}

/// The values behind a declaration: one, or several in brackets.
fn values(
    tokens: &mut Tokens<'_>,
    kind: PbrtKind,
    declaration: &str,
    place: [u32; 2],
    budget: &mut usize,
) -> Result<PbrtValues, Fault> {
    let missing =
        || Fault::new(place, format!("parameter \"{}\" has no value; give one", excerpt(declaration)));
    let mut gathered = Gathered::default();
    match tokens.next()?.ok_or_else(missing)? {
        (Token::Open, _) => loop {
            match tokens.next()? {
                Some((Token::Close, _)) => break,
                Some((Token::Open, at)) => {
                    return Err(Fault::new(at, "a list of values can't hold another one; remove this ["));
                }
                Some((token, at)) => gathered.push(token, at, kind, budget)?,
                None => return Err(Fault::new(place, "this list of values is never closed; add ]")),
            }
        },
        (Token::Close, at) => {
            return Err(Fault::new(at, "there is no list of values to close here; remove this ]"));
        }
        (token, at) => gathered.push(token, at, kind, budget)?,
    }
    gathered.finish(kind, declaration, place)?.ok_or_else(missing)
}

/// Values as they are read.
#[derive(Default)]
struct Gathered {
    numbers: Vec<f64>,
    texts: Vec<String>,
    flags: Vec<bool>,
}

impl Gathered {
    fn push(
        &mut self,
        token: Token<'_>,
        at: [u32; 2],
        kind: PbrtKind,
        budget: &mut usize,
    ) -> Result<(), Fault> {
        *budget = budget.checked_sub(1).ok_or_else(|| {
            Fault::new(at, "the scene holds more values than any that is read; put meshes into .ply files")
        })?;
        match (kind, token) {
            (PbrtKind::Bool, Token::Text(text)) => self.flags.push(flag(&text, at)?),
            (PbrtKind::Bool, Token::Word(word)) => self.flags.push(flag(&String::from_utf8_lossy(word), at)?),
            (PbrtKind::Spectrum, Token::Text(text)) => self.texts.push(text.into_owned()),
            (_, Token::Text(text)) if kind.holds_texts() => self.texts.push(text.into_owned()),
            (_, Token::Word(word)) if !kind.holds_texts() => self.numbers.push(number(word, at)?),
            (_, Token::Text(text)) => {
                let message = format!("a number must stand here, not the text \"{}\"", excerpt(&text));
                return Err(Fault::new(at, message));
            }
            (_, Token::Word(word)) => {
                let word = excerpt(&String::from_utf8_lossy(word));
                return Err(Fault::new(at, format!("a text in quotes must stand here, not {word}")));
            }
            (_, Token::Open | Token::Close) => {}
        }
        Ok(())
    }

    /// The values, `None` where there are none.
    fn finish(self, kind: PbrtKind, declaration: &str, place: [u32; 2]) -> Result<Option<PbrtValues>, Fault> {
        let Self { numbers, texts, flags } = self;
        let wrong =
            |message: String| Err(Fault::new(place, format!("\"{}\": {message}", excerpt(declaration))));
        if !texts.is_empty() && !numbers.is_empty() {
            return wrong("texts and numbers can't be mixed".into());
        }
        if let Some(size) = kind.numbers_per_value()
            && !numbers.len().is_multiple_of(size)
        {
            return wrong(format!("{} numbers can't be divided into values of {size}", numbers.len()));
        }
        if kind == PbrtKind::Spectrum && (!numbers.len().is_multiple_of(2) || texts.len() > 1) {
            return wrong(
                "give pairs of wavelength (nm) and value, or the name of one file or spectrum".into(),
            );
        }
        if kind == PbrtKind::Integer
            && let Some(value) = numbers.iter().find(|value| value.fract() != 0.0)
        {
            return wrong(format!("{value} is not a whole number"));
        }
        Ok(match (numbers.is_empty(), texts.is_empty(), flags.is_empty()) {
            (false, _, _) => Some(PbrtValues::Numbers(numbers)),
            (_, false, _) => Some(PbrtValues::Texts(texts)),
            (_, _, false) => Some(PbrtValues::Flags(flags)),
            _ if kind.holds_texts() => Some(PbrtValues::Texts(texts)),
            _ => Some(PbrtValues::Numbers(numbers)),
        })
    }
}

fn flag(text: &str, at: [u32; 2]) -> Result<bool, Fault> {
    match text {
        "true" => Ok(true),
        "false" => Ok(false),
        _ => Err(Fault::new(at, format!("\"{}\" is neither true nor false", excerpt(text)))),
    }
}
