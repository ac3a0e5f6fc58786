//! Runs array arithmetic with the widest vector instructions that the processor has.

use super::{Dispatch, Kernel};

/// Array arithmetic that gains from wide vector instructions.
///
/// `run` must be marked `#[inline(always)]`, and so must what it calls: only then is it compiled once for each
/// instruction set. It is plain Rust. The compiler neither fuses multiplications with additions nor reorders sums, so
/// results have the same bits whichever instructions run.
pub trait Work {
    /// What comes out.
    type Output;

    /// Does the work.
    fn run(self) -> Self::Output;
}

/// Vector instructions that this processor is known to have.
#[derive(Clone, Copy, Debug)]
pub struct Simd(Dispatch);

impl Simd {
    /// The widest that this processor has.
    pub fn detect() -> Self {
        Self(Dispatch::new(Kernel::fastest()).unwrap_or(Dispatch::Portable))
    }

    /// Those of a kernel; `None` if this processor lacks them.
    pub fn of(kernel: Kernel) -> Option<Self> {
        Dispatch::new(kernel).map(Self)
    }

    /// Does the work with these instructions.
    #[inline]
    pub fn run<W: Work>(self, work: W) -> W::Output {
        match self.0 {
            Dispatch::Portable => work.run(),
            // SAFETY: the tokens prove that the instructions have been detected.
            #[cfg(target_arch = "x86_64")]
            Dispatch::Avx2(_) => unsafe { with_avx2(work) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Dispatch::Avx512(_) => unsafe { with_avx512(work) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1")]
fn with_avx2<W: Work>(work: W) -> W::Output {
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx2,bmi1,bmi2")]
fn with_avx512<W: Work>(work: W) -> W::Output {
    work.run()
}
