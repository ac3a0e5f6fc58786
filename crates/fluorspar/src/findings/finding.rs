//! A number of an evaluation with everything that it is judged by.

use serde::{Deserialize, Serialize, Serializer};

/// What a number is. Fronts word it; results have it in snake case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FindingId {
    /// Share of the analyte in the fluorescence electrons of the analyzed frame, in tissue of which only a family is known.
    Share,
    /// Share of all red emission, of the analyte and of plant pigment, in the same electrons.
    RedShare,
    /// The share is below it with a probability of 95 %.
    ShareUpperLimit,
    /// Smallest share of the region that is told from none in patches that cover a tenth of it; named by what limits it.
    VisibleInPatches,
    /// The same of one that is spread evenly.
    VisibleEvenly,
    /// The share from the mean of the region alone, where its blocks say more.
    ShareOfMean,
    /// Blocks of the region that hold the analyte; judged by the number of all.
    MarkedBlocks,
    /// Probability of no analyte, %; judged by that before the measurement.
    ProbabilityOfNone,
    /// Interval of the share if tissue varied twice as much.
    ShareInWiderFamily,
    /// Probability of a tissue, %, where several are compared.
    TissueProbability,
    /// How much better than the named tissue another explains the colors.
    TissueBayesFactor,
    /// Correlation of the share with the nuisance that is easiest to confuse with it.
    MostConfused,
    /// Interval of the share without one source of uncertainty.
    ShareWithout,
    /// Chi-square of the colors against the family; judged by the number of signals.
    FamilyDistance,
    /// Share on the mixture line, with all that moves it where that is known.
    LineShare,
    /// The same by the sensor's noise alone, where more is known.
    LineShareByNoise,
    /// Half of the interval that the sensor's noise leaves on the line.
    LineNoise,
    /// What moves the share on the line; judged by the share without it.
    LineChange,
    /// Share on the line of the same light without the analyte.
    LineBlank,
    /// Smallest share on the line that noise alone tells from the blank with errors of 5 % either way.
    DetectionLimit,
    /// Amount of the analyte over the amounts of analyte and bulk.
    AmountRatio,
    /// The same of each pixel.
    AmountRatioOfPixels,
    /// Standard error of that of a typical pixel.
    AmountRatioErrorOfPixel,
    /// Distance of pixels from the mixture line, chromaticity.
    LineDistance,
    /// Pixels farther off the line than three standard errors; judged by the pixels used.
    PixelsOffLine,
    /// Angle between the long axis of the pixel cloud and the line, degrees.
    LineAngle,
    /// Pixels beyond an end of the line; judged by the pixels used.
    PixelsBeyondEnd,
    /// Length of the line, chromaticity.
    LineLength,
    /// Share of a fluorophore unmixed from all signals.
    UnmixedShare,
    /// Amount of a fluorophore unmixed from all signals, units of the catalog.
    UnmixedAmount,
    /// Share of light of fluorophores that no term has, which a simulation knows.
    UnmixedOthers,
    /// Root mean square of what the unmixing leaves, standard errors.
    UnmixingMisfit,
    /// True share of the analyte, which a simulation knows.
    TrueShare,
    /// Width of the interval of the share over the true share, %.
    WidthOverTruth,
    /// Upper limit of the share over the true share, %.
    UpperLimitOverTruth,
    /// Detection limit over the true share, %.
    LimitOverTruth,
    /// Separation d' of two spots per pixel; judged by the share of pixels that an ideal observer assigns to the right spot.
    SpotSeparation,
    /// d' of a target.
    TargetSeparation,
    /// d' of a pixel of a target.
    TargetSeparationOfPixel,
    /// d' of a target in the sensor's noise alone.
    TargetSeparationOfSensor,
    /// Contrast of a target in a channel, difference over background.
    TargetContrast,
    /// Contrast of a target in a channel over the noise of a pixel.
    TargetCnr,
    /// Smallest visible diameter of a disc like a target, mm or pixels; judged by the d' that is wanted.
    SmallestDiameter,
    /// Frames to average until a target has the wanted d'.
    FramesNeeded,
    /// Reflected over fluorescent electrons, %.
    Leak,
    /// Median electrons of a pixel.
    MedianSignal,
    /// The same for a millisecond of exposure.
    MedianSignalPerMs,
    /// Signal to noise of a pixel.
    PixelSnr,
    /// Mean electrons of the pixels that are not saturated.
    MeanSignal,
    /// The same in DN.
    MeanLevel,
    /// One signal over another, per second of exposure.
    SignalRatio,
    /// Signal to noise of the mean of a region, all channels of a frame together.
    RegionSnr,
    /// Median share of red in the pixels' signal.
    ChromaticityR,
    /// The same of green.
    ChromaticityG,
    /// Standard deviation of the pixel cloud along its long axis, chromaticity.
    SpreadAlong,
    /// The same along its short axis.
    SpreadAcross,
    /// Pixels of the region.
    PixelsOfRegion,
    /// Pixels that count.
    PixelsUsed,
    /// Pixels that are saturated.
    PixelsSaturated,
    /// Pixels below the noise floor; judged by that floor, DN.
    PixelsBelowNoise,
    /// Pixels whose channels have no positive sum.
    PixelsWithoutSignal,
    /// Median level of a channel, DN.
    MedianLevel,
    /// Exposure time of a frame, ms.
    Exposure,
    /// Saturated pixels, %, of a frame or of the region.
    Clipped,
    /// Captures of a frame that eyes and tissue bear in 8 hours.
    SafeCaptures,
    /// Whole sequences of captures that eyes and tissue bear in 8 hours.
    SafeSequences,
}

/// What of a number's value or interval a reader must know.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Caveat {
    /// The interval holds the sensor's noise and nothing else: neither that of the render nor what is assumed.
    SensorNoiseAlone,
    /// No analyte can't be excluded: the interval ends at an upper limit.
    NotDetected,
    /// Patches of this would look the same to the camera.
    LooksLike(&'static str),
    /// The light is that of no tissue that was compared: there is no estimate.
    NoEstimate,
    /// The light is not that of the named tissue; this other one explains it.
    OtherTissue(String),
    /// Half of the pixels or more are saturated: the light may be any stronger.
    LowerLimit,
    /// So many of the pixels are saturated, 0 to 1.
    Saturated(f64),
    /// The interval is that of the share if light that fluoresced twice counts one way or the other.
    FluorescedTwice,
    /// The estimate is from these frames together.
    FromFrames(Vec<String>),
    /// The true share of the bulk holds it, as the fit of two terms does.
    CountsAsBulk,
    /// The noise of the render is so many times the rest in variance and was taken out; so many samples per pixel make it a quarter.
    RenderNoise(f64, u32),
    /// The conversion gain is that of the experiment's sensor.
    AssumedGain,
    /// The interval is that of nine tenths of the pixels.
    NineTenths,
    /// The interval reaches one standard deviation of the pixels to both sides.
    StandardDeviation,
    /// There are no bounds: more fit into the day than lights shine in it, or no number of frames is enough.
    Unbounded,
}

/// A number of an evaluation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// What it is.
    pub id: FindingId,
    /// The region beside that of the analysis that it is of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<String>,
    /// The frame that it is of; several are joined by " + ".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<String>,
    /// The channel that it is of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel: Option<String>,
    /// The fluorophore, tissue, source or target that it is of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The number; `None` where there is an interval or a caveat only.
    pub value: Option<f64>,
    /// Of 95 %, unless a caveat says otherwise; an open end is infinite, in JSON null.
    #[serde(serialize_with = "open_ends")]
    pub interval: Option<[f64; 2]>,
    /// What it is judged by: the truth of an estimate, the probability before a measurement, the number that is expected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<f64>,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
    /// What a reader must know.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub caveats: Vec<Caveat>,
}

impl Finding {
    /// A number without subject and interval.
    #[must_use]
    pub fn new(id: FindingId, value: impl Into<Option<f64>>) -> Self {
        Self {
            id,
            region: None,
            frame: None,
            channel: None,
            name: None,
            value: value.into(),
            interval: None,
            reference: None,
            unit: id.unit(),
            caveats: Vec::new(),
        }
    }

    pub(super) fn of_frame(self, frame: impl Into<String>) -> Self {
        Self { frame: Some(frame.into()), ..self }
    }

    pub(super) fn in_channel(self, channel: impl Into<String>) -> Self {
        Self { channel: Some(channel.into()), ..self }
    }

    pub(super) fn named(self, name: impl Into<String>) -> Self {
        Self { name: Some(name.into()), ..self }
    }

    pub(super) fn within(self, interval: [f64; 2]) -> Self {
        Self { interval: Some(interval), ..self }
    }

    pub(super) fn judged_by(self, reference: impl Into<Option<f64>>) -> Self {
        Self { reference: reference.into(), ..self }
    }

    pub(super) fn with(mut self, caveat: Caveat) -> Self {
        self.caveats.push(caveat);
        self
    }

    /// Whether a reader must know this.
    #[must_use]
    pub fn has(&self, caveat: &Caveat) -> bool {
        self.caveats.contains(caveat)
    }
}

impl FindingId {
    /// Unit of the number; empty for a pure number.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::ProbabilityOfNone
            | Self::TissueProbability
            | Self::WidthOverTruth
            | Self::UpperLimitOverTruth
            | Self::LimitOverTruth
            | Self::Leak
            | Self::Clipped => "%",
            Self::PixelsOffLine
            | Self::PixelsBeyondEnd
            | Self::PixelsOfRegion
            | Self::PixelsUsed
            | Self::PixelsSaturated
            | Self::PixelsBelowNoise
            | Self::PixelsWithoutSignal => "pixels",
            Self::MedianSignal | Self::MeanSignal => "e-",
            Self::MedianSignalPerMs => "e-/ms",
            Self::MeanLevel | Self::MedianLevel => "DN",
            Self::LineDistance | Self::LineLength => "r, g",
            Self::LineAngle => "degrees",
            Self::UnmixedAmount => "units",
            Self::UnmixingMisfit => "standard errors",
            Self::SmallestDiameter => "mm",
            Self::FramesNeeded => "frames",
            Self::Exposure => "ms",
            Self::SafeCaptures | Self::SafeSequences => "in 8 h",
            _ => "",
        }
    }
}

/// Intervals in JSON: an open end is null.
fn open_ends<S: Serializer>(interval: &Option<[f64; 2]>, serializer: S) -> Result<S::Ok, S::Error> {
    interval.map(|ends| ends.map(|end| end.is_finite().then_some(end))).serialize(serializer)
}
