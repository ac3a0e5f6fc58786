//! Ranges of normal values from sums over people: adjusted for age and site, with repeated visits, pooled without the people.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal};

use super::ValueRange;
use super::tolerance::{CONTENT, normal_factor};
use crate::sampling::Z_95;

/// Of one side with 95 %.
const Z_ONE_SIDED: f64 = 1.644_853_626_951_472_7;

/// Ages are counted from here, in decades.
const AGE_ZERO: f64 = 40.0;
const AGE_UNIT: f64 = 10.0;

/// What is measured of a person.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NormPerson {
    /// Where the person is examined.
    pub site: String,
    /// Years; `None` where no age is asked for.
    pub age: Option<f64>,
    /// One value a visit.
    pub values: Vec<f64>,
    /// How far the 95 % intervals of the values reach below and above them, squared, as a mean; `None` where no error is known.
    pub error: Option<[f64; 2]>,
}

/// Sums over the people of a site: of their means over visits, straightened, and ages. Sums of joint people are the sums of theirs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SiteSums {
    /// The site.
    pub site: String,
    /// People.
    pub people: u64,
    /// Sum of ages, decades from 40 years; 0 without ages.
    pub age: f64,
    /// Of their squares.
    pub age_age: f64,
    /// Of ages times means.
    pub age_value: f64,
    /// Of means.
    pub value: f64,
    /// Of their squares.
    pub value_value: f64,
    /// Of squares of values less the mean of their person.
    pub within: f64,
    /// Visits beyond the first.
    pub within_degrees: u64,
    /// Of one over the visits of each person.
    pub inverse_visits: f64,
    /// Of its square.
    #[serde(default)]
    pub inverse_visits_squared: f64,
    /// People whose values have intervals.
    #[serde(default)]
    pub with_error: u64,
    /// Sum over these people of how far the intervals reach below and above the values, squared.
    #[serde(default)]
    pub error: [f64; 2],
    /// Of the squares of that.
    #[serde(default)]
    pub error_squared: [f64; 2],
}

impl SiteSums {
    fn add(&mut self, other: &Self) {
        self.people += other.people;
        self.age += other.age;
        self.age_age += other.age_age;
        self.age_value += other.age_value;
        self.value += other.value;
        self.value_value += other.value_value;
        self.within += other.within;
        self.within_degrees += other.within_degrees;
        self.inverse_visits += other.inverse_visits;
        self.inverse_visits_squared += other.inverse_visits_squared;
        self.with_error += other.with_error;
        self.error = [0, 1].map(|side| self.error[side] + other.error[side]);
        self.error_squared = [0, 1].map(|side| self.error_squared[side] + other.error_squared[side]);
    }

    fn remove(&mut self, other: &Self) {
        // A file may hold sums of other people than it says
        self.people = self.people.saturating_sub(other.people);
        self.age -= other.age;
        self.age_age -= other.age_age;
        self.age_value -= other.age_value;
        self.value -= other.value;
        self.value_value -= other.value_value;
        self.within -= other.within;
        self.within_degrees = self.within_degrees.saturating_sub(other.within_degrees);
        self.inverse_visits -= other.inverse_visits;
        self.inverse_visits_squared -= other.inverse_visits_squared;
        self.with_error = self.with_error.saturating_sub(other.with_error);
        self.error = [0, 1].map(|side| (self.error[side] - other.error[side]).max(0.0));
        self.error_squared =
            [0, 1].map(|side| (self.error_squared[side] - other.error_squared[side]).max(0.0));
    }

    /// `None` of a person without a value that `range` allows, or without the age that is asked for.
    fn of(person: &NormPerson, range: ValueRange, by_age: bool) -> Option<Self> {
        let values: Vec<f64> = person.values.iter().filter_map(|value| range.straightened(*value)).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let age = if by_age { (person.age? - AGE_ZERO) / AGE_UNIT } else { 0.0 };
        (!values.is_empty()).then(|| Self {
            site: person.site.clone(),
            people: 1,
            age,
            age_age: age * age,
            age_value: age * mean,
            value: mean,
            value_value: mean * mean,
            within: values.iter().map(|value| (value - mean).powi(2)).sum(),
            within_degrees: values.len() as u64 - 1,
            inverse_visits: 1.0 / n,
            inverse_visits_squared: 1.0 / (n * n),
            with_error: u64::from(person.error.is_some()),
            error: person.error.unwrap_or_default(),
            error_squared: person.error.unwrap_or_default().map(|error| error * error),
        })
    }

    fn means(&self) -> [f64; 2] {
        [self.age / self.people as f64, self.value / self.people as f64]
    }
}

/// What is normal: sums over people, by site.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NormSums {
    /// Which values the number can take.
    pub range: ValueRange,
    /// Whether the number is adjusted for age.
    pub by_age: bool,
    /// Sums of each site, by name.
    pub sites: Vec<SiteSums>,
}

/// Why there is no norm.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NormError {
    /// Too few people, in all or at a site.
    #[error("{found} people{} are too few for a norm, which takes {least}", of_site(.site))]
    FewPeople {
        /// The site; empty for all.
        site: String,
        /// People.
        found: u64,
        /// Fewest.
        least: u64,
    },
    /// All people are alike, or all of one age.
    #[error("all people have the same {0}")]
    NoSpread(&'static str),
    /// Norms of other kinds of numbers.
    #[error("one norm is adjusted for age and the other not, or their numbers are of different kinds")]
    Unlike,
    /// A site whose people the norm does not hold.
    #[error("the norm has no people of the site \"{0}\", and sites differ")]
    OtherSite(String),
    /// An age is needed.
    #[error("the norm is adjusted for age; give that of the person")]
    NoAge,
    /// Sums whose squares, or a range whose ends, are beyond what a number holds.
    #[error("its numbers overflow")]
    Overflow,
}

fn of_site(site: &str) -> String {
    if site.is_empty() { String::new() } else { format!(" of the site \"{site}\"") }
}

impl NormSums {
    /// Fewest people of a site.
    pub const LEAST: u64 = 10;

    /// The sums of people; those without a value or without the age that is asked for are left out.
    #[must_use]
    pub fn of(people: &[NormPerson], range: ValueRange, by_age: bool) -> Self {
        let mut sums = Self { range, by_age, sites: Vec::new() };
        for of in people.iter().filter_map(|person| SiteSums::of(person, range, by_age)) {
            sums.add_site(&of);
        }
        sums
    }

    fn add_site(&mut self, of: &SiteSums) {
        match self.sites.binary_search_by(|site| site.site.cmp(&of.site)) {
            Ok(at) => self.sites[at].add(of),
            Err(at) => self.sites.insert(at, of.clone()),
        }
    }

    /// The sums of the others, where these hold the person: nobody lies more than `(n - 1) / sqrt(n)` standard deviations from the mean
    /// of n people that he is one of, so a person is compared with the others.
    #[must_use]
    pub fn without(&self, person: &NormPerson) -> Self {
        let mut others = self.clone();
        if let Some(of) = SiteSums::of(person, self.range, self.by_age)
            && let Ok(at) = others.sites.binary_search_by(|site| site.site.cmp(&of.site))
            && others.sites[at].people > of.people
        {
            others.sites[at].remove(&of);
        }
        others
    }

    /// The sums of the people of both.
    ///
    /// # Errors
    /// [`NormError::Unlike`].
    pub fn pooled(&self, other: &Self) -> Result<Self, NormError> {
        if (self.range, self.by_age) != (other.range, other.by_age) {
            return Err(NormError::Unlike);
        }
        let mut pooled = self.clone();
        other.sites.iter().for_each(|site| pooled.add_site(site));
        Ok(pooled)
    }

    /// People of all sites.
    #[must_use]
    pub fn people(&self) -> u64 {
        self.sites.iter().map(|site| site.people).sum()
    }

    /// The norm: each site has a mean of its own; slope over age and spread are those of all.
    ///
    /// # Errors
    /// Too few people, or people who are all alike.
    pub fn fit(&self) -> Result<Norm, NormError> {
        self.fitted(Self::LEAST)
    }

    /// The same of the others of a norm, [`Self::without`] one of its people.
    ///
    /// # Errors
    /// As [`Self::fit`].
    pub fn fit_of_others(&self) -> Result<Norm, NormError> {
        self.fitted(Self::LEAST - 1)
    }

    fn fitted(&self, least: u64) -> Result<Norm, NormError> {
        let few = |site: &str, found: u64| NormError::FewPeople { site: site.into(), found, least };
        if self.sites.is_empty() {
            return Err(few("", 0));
        }
        if let Some(site) = self.sites.iter().find(|site| site.people < least) {
            return Err(few(&site.site, site.people));
        }
        let total = |of: &dyn Fn(&SiteSums) -> f64| self.sites.iter().map(of).sum::<f64>();
        let age_age = total(&|of| of.age_age - of.age * of.means()[0]);
        let age_value = total(&|of| of.age_value - of.value * of.means()[0]);
        let value_value = total(&|of| of.value_value - of.value * of.means()[1]);
        if self.by_age && age_age <= 1e-9 {
            return Err(NormError::NoSpread("age"));
        }
        let slope = if self.by_age { age_value / age_age } else { 0.0 };
        let people = self.people() as f64;
        let between_degrees = people - self.sites.len() as f64 - f64::from(u8::from(self.by_age));
        let between = (value_value - slope * age_value).max(0.0) / between_degrees;
        let within_degrees = self.sites.iter().map(|site| site.within_degrees).sum::<u64>() as f64;
        let within = (within_degrees > 0.0).then(|| total(&|of| of.within) / within_degrees);
        // One visit of a person varies by more than the mean of several does
        let inverse = total(&|of| of.inverse_visits) / people;
        let added = within.unwrap_or(0.0) * (1.0 - inverse);
        let variance = between + added;
        if variance <= 1e-24 {
            return Err(NormError::NoSpread("value"));
        }
        let degrees = match within.filter(|_| added > 0.0) {
            None => between_degrees,
            Some(within) => {
                let squares = (total(&|of| of.inverse_visits_squared) / people).max(inverse * inverse);
                let own = unequal_degrees(between, within, [inverse, squares]) * between_degrees;
                degrees_of_sum([(between, own), (added, within_degrees)], between / inverse)
            }
        };
        let sd = variance.sqrt();
        Ok(Norm { sums: self.clone(), slope, age_age, sd, degrees, sd_within: within.map(f64::sqrt) })
    }
}

/// What part of its degrees of freedom the variance of means has whose own variances differ (Satterthwaite, Biometrics Bulletin 2, 110,
/// 1946), from the means of one over their visits and of its square.
fn unequal_degrees(between: f64, within: f64, [inverse, squares]: [f64; 2]) -> f64 {
    let person = (between - within * inverse).max(0.0);
    let first = person + within * inverse;
    let second = person * person + 2.0 * person * within * inverse + within * within * squares;
    first * first / second
}

/// Degrees of freedom of a sum of variances with degrees of their own: those of a single variance whose upper limit is as many times larger
/// as that of the sum (Graybill and Wang, J. Am. Stat. Assoc. 75, 869, 1980). `most` is larger than the sum, in proportion to the first.
fn degrees_of_sum([first, second]: [(f64, f64); 2], most: f64) -> f64 {
    let sum = first.0 + second.0;
    let above = (first.0 * excess(first.1)).hypot(second.0 * excess(second.1));
    let limit = (sum + above).min(most * (1.0 + excess(first.1)));
    let root = 1.0 - (limit / sum).max(1.0).powf(-1.0 / 3.0);
    let root = 0.5 * ((Z_ONE_SIDED * Z_ONE_SIDED + 4.0 * root).sqrt() - Z_ONE_SIDED);
    (2.0 / (9.0 * root * root)).min(first.1 + second.1)
}

/// How far the upper 95 % limit of a variance lies above it, relative (Wilson and Hilferty, Proc. Natl. Acad. Sci. 17, 684, 1931).
fn excess(degrees: f64) -> f64 {
    let square = 2.0 / (9.0 * degrees);
    (1.0 - square - Z_ONE_SIDED * square.sqrt()).max(1e-3).powi(-3) - 1.0
}

/// What is normal, fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct Norm {
    sums: NormSums,
    /// Of the straightened number over a decade of age.
    slope: f64,
    age_age: f64,
    /// Standard deviation of the straightened number of one visit among people of one age and site.
    pub sd: f64,
    /// Its degrees of freedom.
    pub degrees: f64,
    /// That of visits of one person, where people came again.
    pub sd_within: Option<f64>,
}

/// Where a person stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Standing {
    /// With 95 % confidence among the middle 95 % of people: its percentile lies within 2.5 to 97.5.
    Inside,
    /// Beyond the range that holds 95 % of people with 95 % confidence.
    Outside,
    /// Neither.
    CannotTell,
}

/// A number against a norm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NormPlace {
    /// The range that holds 95 % of people of this age and site with 95 % confidence.
    pub range: [f64; 2],
    /// Where 95 % of what is known puts the percentile, 0 to 100.
    pub percentile: [f64; 2],
    /// Where the person stands.
    pub standing: Standing,
}

impl Norm {
    /// Mean of the straightened number for an age and a site, and the leverage: its variance over that of a person.
    fn center(&self, age: Option<f64>, site: &str) -> Result<[f64; 2], NormError> {
        let own = self.sums.sites.iter().find(|of| of.site == site);
        let only = self.sums.sites.first().filter(|_| self.sums.sites.len() == 1);
        let of = own.or(only).ok_or_else(|| NormError::OtherSite(site.into()))?;
        let [mean_age, mean] = of.means();
        let by_age = if self.sums.by_age {
            (age.ok_or(NormError::NoAge)? - AGE_ZERO) / AGE_UNIT - mean_age
        } else {
            0.0
        };
        let leverage =
            1.0 / of.people as f64 + if self.sums.by_age { by_age * by_age / self.age_age } else { 0.0 };
        Ok([mean + self.slope * by_age, leverage])
    }

    /// The range that holds 95 % of people of an age and a site with 95 % confidence; a norm of one site serves all.
    ///
    /// # Errors
    /// A site that the norm does not hold, an age that is missing, numbers that overflow.
    pub fn range(&self, age: Option<f64>, site: &str) -> Result<[f64; 2], NormError> {
        let [center, leverage] = self.center(age, site)?;
        let reach = normal_factor(leverage, self.degrees) * self.sd;
        let range = [center - reach, center + reach].map(|end| self.sums.range.bent(end));
        if range.iter().all(|end| end.is_finite()) { Ok(range) } else { Err(NormError::Overflow) }
    }

    /// The 95 % interval of a number less the error that numbers of the norm have, whose spread is that of people and of error together:
    /// what is left is what makes this number more doubtful than theirs. Errors up to two standard deviations above their mean are such as
    /// theirs.
    #[must_use]
    pub fn beyond_own_error(&self, value: f64, [low, high]: [f64; 2]) -> [f64; 2] {
        let sites = &self.sums.sites;
        let people = sites.iter().map(|of| of.with_error).sum::<u64>().max(1) as f64;
        let usual = |side: usize| {
            let mean = sites.iter().map(|of| of.error[side]).sum::<f64>() / people;
            let square = sites.iter().map(|of| of.error_squared[side]).sum::<f64>() / people;
            mean + 2.0 * (square - mean * mean).max(0.0).sqrt()
        };
        let left = |reach: f64, side| (reach.powi(2) - usual(side)).max(0.0).sqrt();
        [value - left(value - low, 0), value + left(high - value, 1)]
    }

    /// A number with its 95 % interval against the norm, by its ends. Ends at an end of what is possible count as beyond everybody.
    ///
    /// # Errors
    /// As [`Self::range`].
    pub fn place(&self, interval: [f64; 2], age: Option<f64>, site: &str) -> Result<NormPlace, NormError> {
        let range = self.range(age, site)?;
        let [center, leverage] = self.center(age, site)?;
        let percentile = |end: f64, sign: f64| {
            let beyond = if end > 0.0 { f64::INFINITY } else { f64::NEG_INFINITY };
            let straight = self.sums.range.straightened(end).unwrap_or(beyond);
            let distance = (straight - center) / self.sd;
            if distance.is_infinite() {
                return if distance > 0.0 { 100.0 } else { 0.0 };
            }
            let error = (leverage + distance * distance / (2.0 * self.degrees)).sqrt();
            100.0 * Normal::standard().cdf(distance + sign * Z_95 * error)
        };
        let [low, high] = interval;
        let percentile = [percentile(low, -1.0), percentile(high, 1.0)];
        let middle = 50.0 * (1.0 - CONTENT)..=50.0 * (1.0 + CONTENT);
        let standing = if high < range[0] || low > range[1] {
            Standing::Outside
        } else if percentile.iter().all(|end| middle.contains(end)) {
            Standing::Inside
        } else {
            Standing::CannotTell
        };
        Ok(NormPlace { range, percentile, standing })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::random::Key;

    fn person(value: f64) -> NormPerson {
        NormPerson { values: vec![value], ..NormPerson::default() }
    }

    #[test]
    fn a_number_at_an_end_of_its_range_is_beyond_everybody() {
        let people: Vec<NormPerson> = (0..20).map(|k| person(0.3 + 0.01 * f64::from(k))).collect();
        let norm = NormSums::of(&people, ValueRange::Share, false).fit().unwrap();
        for (number, percentile) in [(0.0, 0.0), (1.0, 100.0)] {
            let place = norm.place([number; 2], None, "").unwrap();
            assert_eq!((place.standing, place.percentile), (Standing::Outside, [percentile; 2]));
        }
    }

    #[test]
    fn a_person_stands_outside_of_the_others_alone() {
        let visits = |k: f64| vec![(0.1 * k).sin(), (0.1 * k).sin() + 0.02];
        let mut people: Vec<NormPerson> = (0..12)
            .map(|k| NormPerson {
                site: "north".into(),
                age: Some(20.0 + 5.0 * f64::from(k)),
                values: visits(f64::from(k * k)),
                ..NormPerson::default()
            })
            .collect();
        let apart = NormPerson { values: vec![9.0], ..people[3].clone() };
        people[3] = apart.clone();
        let all = NormSums::of(&people, ValueRange::Real, true);
        let standing =
            |sums: &NormSums| sums.fit().unwrap().place([9.0; 2], apart.age, "north").unwrap().standing;
        assert_eq!(standing(&all), Standing::CannotTell);
        let others = all.without(&apart);
        assert_eq!(standing(&others), Standing::Outside);
        people.remove(3);
        let expected = NormSums::of(&people, ValueRange::Real, true).fit().unwrap();
        let found = others.fit().unwrap();
        assert!((found.sd / expected.sd - 1.0).abs() < 1e-10 && (found.slope - expected.slope).abs() < 1e-10);
        assert_eq!(others.people(), 11);
    }

    /// 20 to 80 years.
    fn age_of(key: Key) -> f64 {
        20.0 + 60.0 * (key.value() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// People of a study: normal, log-normal or growing with age.
    fn study(kind: usize, n: u64, seed: u64) -> (NormSums, Vec<f64>) {
        let key = Key::new(7).with(kind as u64).with(n).with(seed);
        let people: Vec<NormPerson> = (0..n)
            .map(|k| {
                let of = key.with(k);
                let (age, z) = (age_of(of.with(1)), of.with(2).normal());
                let value = match kind {
                    0 => 10.0 + 2.0 * z,
                    1 => (0.8 * z).exp(),
                    _ => 5.0 + 0.05 * age + 0.7 * z,
                };
                NormPerson { age: Some(age), ..person(value) }
            })
            .collect();
        let range = if kind == 1 { ValueRange::Positive } else { ValueRange::Real };
        (NormSums::of(&people, range, kind == 2), vec![25.0, 50.0, 75.0])
    }

    /// Of 1000 studies each at least 93 % have a range that holds 95 % of all people.
    #[test]
    fn ranges_hold_people_in_as_many_studies_as_they_say() {
        let normal = Normal::standard();
        for kind in 0..3 {
            for n in [10, 20, 40, 120] {
                let holds = |seed: &u64| {
                    let (sums, ages) = study(kind, n, *seed);
                    let norm = sums.fit().unwrap();
                    // One age a study, of all
                    let age = ages[*seed as usize % 3];
                    let below = |end: f64| match kind {
                        0 => normal.cdf((end - 10.0) / 2.0),
                        1 => normal.cdf(end.ln() / 0.8),
                        _ => normal.cdf((end - 5.0 - 0.05 * age) / 0.7),
                    };
                    let [low, high] = norm.range(Some(age), "").unwrap();
                    below(high) - below(low) >= CONTENT
                };
                let share = (0..1000).filter(holds).count() as f64 / 1000.0;
                assert!(share >= 0.93, "{kind}, {n}: {share}");
                assert!(share <= 0.975, "needlessly wide: {kind}, {n}: {share}");
            }
        }
    }

    /// Ten people whose two visits differ by less than they do: the range is that of one visit of a new person.
    #[test]
    fn ranges_of_people_who_came_again_hold_single_visits() {
        let normal = Normal::standard();
        // Visits of each person in turn, and the spread of people and of visits
        let studies: [(&[u64], usize, f64, f64); 6] = [
            (&[1, 2, 3, 4], 20, 3.0, 2.0),
            (&[3], 10, 1.0, 0.5),
            (&[2, 2, 2, 2, 2, 40, 1, 1, 1, 1], 10, 0.3, 2.0),
            (&[12, 1, 1, 1, 1], 20, 0.3, 2.0),
            (&[2, 1, 1, 1, 1, 1, 1, 1, 1, 1], 10, 1.0, 0.5),
            (&[2, 1], 80, 1.0, 1.0),
        ];
        for (visits, n, between, within) in studies {
            let holds = |seed: &u64| {
                let key = Key::new(9).with(*seed);
                let people: Vec<NormPerson> = (0..n)
                    .map(|k| {
                        let of = key.with(k as u64);
                        let own = between * of.with(1).normal();
                        let visit = |visit| own + within * of.with(2).with(visit).normal();
                        NormPerson {
                            values: (0..visits[k % visits.len()]).map(visit).collect(),
                            ..NormPerson::default()
                        }
                    })
                    .collect();
                let norm = NormSums::of(&people, ValueRange::Real, false).fit().unwrap();
                let [low, high] = norm.range(None, "").unwrap();
                let sd = between.hypot(within);
                normal.cdf(high / sd) - normal.cdf(low / sd) >= CONTENT
            };
            let share = (0..1000).filter(holds).count() as f64 / 1000.0;
            assert!(share >= 0.93, "{n} people, {visits:?}, {between} and {within}: {share}");
        }
    }

    /// The sums of two sites are those of their people together.
    #[test]
    fn norms_of_sites_pool_without_their_people() {
        let of_site = |site: &str, n: u64, shift: f64| -> Vec<NormPerson> {
            let key = Key::new(11).with(n);
            let one = |k| {
                let age = Some(age_of(key.with(k).with(1)));
                let values = (0..1 + k % 2).map(|v| (0.3 * key.with(k).with(2 + v).normal() + shift).exp());
                NormPerson { site: site.into(), age, values: values.collect(), error: None }
            };
            (0..n).map(one).collect()
        };
        let (a, b) = (of_site("A", 31, 0.0), of_site("B", 17, 0.5));
        let of = |people: &[NormPerson]| NormSums::of(people, ValueRange::Positive, true);
        let joint = of(&[b.clone(), a.clone()].concat()).fit().unwrap();
        let text = serde_json::to_string(&of(&b)).unwrap();
        let pooled = of(&a).pooled(&serde_json::from_str(&text).unwrap()).unwrap().fit().unwrap();
        for site in ["A", "B"] {
            for (x, y) in
                joint.range(Some(33.0), site).unwrap().iter().zip(pooled.range(Some(33.0), site).unwrap())
            {
                assert!((x / y - 1.0).abs() < 1e-12, "{x} {y}");
            }
        }
        assert_eq!(joint.range(Some(33.0), "C"), Err(NormError::OtherSite("C".into())));
        assert_eq!(joint.range(None, "A"), Err(NormError::NoAge));
        assert_eq!(of(&a).pooled(&NormSums::of(&b, ValueRange::Positive, false)), Err(NormError::Unlike));
    }

    /// Numbers with more error than spread: healthy people are no more often outside than the range says, one who is measured worse can't be
    /// told.
    #[test]
    fn errors_that_all_numbers_have_count_once() {
        const ERROR: f64 = 2.0;
        let measured =
            |key: Key, error: f64| 20.0 + 0.5 * key.with(1).normal() + error * key.with(2).normal();
        let interval = |value: f64, error: f64| [value - Z_95 * error, value + Z_95 * error];
        let mut counts = [0; 4];
        for study in 0..200 {
            let key = Key::new(13).with(study);
            let people: Vec<NormPerson> = (0..40)
                .map(|k| {
                    // Intervals differ by a tenth
                    let error = ERROR * (1.0 + 0.1 * (k as f64).sin());
                    let reach = [(Z_95 * error).powi(2); 2];
                    NormPerson { error: Some(reach), ..person(measured(key.with(k), ERROR)) }
                })
                .collect();
            let sums = NormSums::of(&people, ValueRange::Real, false);
            let others = sums.without(&people[0]).fit().unwrap();
            let expected = NormSums::of(&people[1..], ValueRange::Real, false).fit().unwrap();
            let [found, expected] =
                [others, expected].map(|norm| norm.beyond_own_error(20.0, interval(20.0, 3.0)));
            assert!((found[0] - expected[0]).abs() < 1e-9 && (found[1] - expected[1]).abs() < 1e-9);
            let norm = sums.fit().unwrap();
            let standing = |value: f64, error: f64| {
                let left = norm.beyond_own_error(value, interval(value, error));
                norm.place(left, None, "").unwrap().standing
            };
            let value = measured(key.with(99), ERROR);
            counts[0] += u32::from(standing(value, ERROR) == Standing::Inside);
            counts[3] += u32::from(standing(value, ERROR) == Standing::Outside);
            counts[1] += u32::from(standing(value + 20.0, ERROR) == Standing::Outside);
            counts[2] += u32::from(standing(20.0, 2.0 * ERROR) == Standing::CannotTell);
        }
        // Inside are the 84 % within 1.4 standard deviations, outside at most 5 %
        assert!(counts[0] >= 150 && counts[1] == 200 && counts[2] >= 195 && counts[3] <= 10, "{counts:?}");
        let plain =
            NormSums::of(&(0..10).map(|k| person(f64::from(k))).collect::<Vec<_>>(), ValueRange::Real, false);
        assert_eq!(plain.fit().unwrap().beyond_own_error(4.0, [1.0, 9.0]), [1.0, 9.0]);
    }

    #[test]
    fn few_and_equal_people_have_no_norm_and_intervals_decide() {
        let people: Vec<NormPerson> = (0..10).map(|k| person(f64::from(k))).collect();
        let few = NormSums::of(&people[..9], ValueRange::Real, false).fit().unwrap_err();
        assert_eq!(few.to_string(), "9 people are too few for a norm, which takes 10");
        let equal = vec![person(1.0); 12];
        assert_eq!(NormSums::of(&equal, ValueRange::Real, false).fit(), Err(NormError::NoSpread("value")));
        let norm = NormSums::of(&people, ValueRange::Real, false).fit().unwrap();
        // Mean 4.5, standard deviation 3.0277, factor 3.38
        let [low, high] = norm.range(None, "").unwrap();
        assert!((low + 5.75).abs() < 0.05 && (high - 14.75).abs() < 0.05, "{low} {high}");
        let standing = |a, b| norm.place([a, b], None, "").unwrap().standing;
        assert_eq!(standing(4.0, 6.0), Standing::Inside);
        assert_eq!(standing(4.0, 14.0), Standing::CannotTell);
        assert_eq!(standing(14.0, 16.0), Standing::CannotTell);
        assert_eq!(standing(15.0, 16.0), Standing::Outside);
        let place = norm.place([4.5, 4.5], None, "").unwrap();
        assert!(place.percentile[0] < 30.0 && place.percentile[1] > 70.0, "{place:?}");
    }
}
