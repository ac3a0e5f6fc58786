//! Clinical studies: photographs of people in a folder, what is estimated of them, what is normal among them, and what may leave the clinic.
//!
//! The folder is the truth: files in the shape of BIDS, and `log.jsonl`, to which every command appends what it did, each line with the
//! digest of the one before. `.fluorspar/study.sqlite` is an index of that log, made anew whenever it is missing or behind.
//!
//! | to | call |
//! |---|---|
//! | begin a study | [`init`] |
//! | take photographs, people and outcomes in | [`import`] |
//! | estimate what has no estimate | [`analyze`] |
//! | ask for numbers | [`query`] |
//! | say what is normal, pool what several sites say | [`norm`] |
//! | hold people against a norm | [`compare`] |
//! | write what may leave the clinic | [`export`] |
//! | check every file and the log, rebuild the index | [`verify`], [`reindex`] |
//! | say what a change of the analysis changed | [`drift`] |
//! | take a person out | [`withdraw`] |

mod analyze;
mod clock;
mod compare;
mod deidentify;
mod dicom;
mod drift;
mod event;
mod export;
mod import;
mod index;
mod log;
mod norm;
mod outside;
mod query;
mod secret;
mod store;
mod verify;

pub use analyze::{AnalyzeStudyOptions, AnalyzedStudy, analyze};
pub use compare::{AgainstNormOptions, ComparedPeople, PersonAgainstNorm, Separation, compare};
pub use drift::{Drift, DriftOptions, QuantityDrift, drift};
pub use event::{Event, StoredFile};
pub use export::{ExportOptions, ExportedStudy, export};
pub use import::{ImportOptions, ImportedStudy, import};
pub use norm::{NormOptions, NormReport, norm};
pub use query::{QueriedRow, QueryOptions, query};
pub use store::{BegunStudy, InitOptions, StudyArgs, init};
pub use verify::{VerifiedStudy, WithdrawOptions, reindex, verify, withdraw};
