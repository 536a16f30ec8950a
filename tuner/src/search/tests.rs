//! The search against exhaustion, on a made-up response with the shape that measured ones have.

use super::{CandidateSet, SearchGrid, SearchRequest, SearchResult, search, search_with_margin};
use crate::Contract;
use crate::evaluator::{Batches, Evaluator, Measurement, TrialError};
use crate::tune::{Study, Trial, tune};
use crate::utility::Utility;
use lamina_model::{Cost, GenerationParams, Invalid, Quality, Representation, ViewError};
use std::time::Duration;
use tokio::time::Instant;

mod economy;

/// sigma = 2 r^1.75 (gamma + 0.01)^-0.45 with a ripple, tau = r^1.6 us, squared error (245 / r)^2.2 2e-4 + (gamma / 0.03)^1.1
/// 1e-4, with batches that scatter by a fifth. Volumes with all 512 points have no error but that of their coding.
#[derive(Default)]
struct Response {
    /// Bytes of volumes are more than those of VDIs by this power of two.
    dearer: i32,
    /// No volume can stand for the step.
    irreducible: bool,
    /// The size jumps by a factor of 8 where gamma falls below this.
    jump: f64,
    /// Batches of each trial scatter by this much of their own, beside what they share.
    own_scatter: f64,
    /// Every size and error is that of another step: larger by this share.
    richer: f64,
    /// What a march or a measurement takes.
    takes: Duration,
    measured: usize,
    /// Parameters timed alone.
    timed: usize,
    marches: usize,
    batches: usize,
    calls: u32,
}

impl Response {
    async fn takes_time(&mut self) {
        self.calls += 1;
        if self.takes > Duration::ZERO {
            tokio::time::sleep(self.takes).await;
        }
    }

    fn cost(&self, p: &GenerationParams) -> Cost {
        let (r, gamma) = (f64::from(p.resolution()), p.gamma());
        let dearer = if p.representation() == Representation::Volume { 2_f64.powi(self.dearer) } else { 1.0 };
        let ripple = 1.0 + 0.02 * (r / 50.0).sin() * (60.0 * gamma).cos();
        let jump = if gamma < self.jump { 8.0 } else { 1.0 } * (1.0 + self.richer);
        let size_bytes = (2.0 * r.powf(1.75) * (gamma + 0.01).powf(-0.45) * ripple * dearer * jump) as u64;
        let generation_time = Duration::from_nanos((1e3 * r.powf(1.6)) as u64);
        Cost { size_bytes, generation: generation_time, encode: generation_time, elements: 1 }
    }

    fn quality(&self, p: &GenerationParams, batches: u32) -> Quality {
        let (r, gamma) = (f64::from(p.resolution()), p.gamma());
        let all_points = if p.representation() == Representation::Volume { (245.0 / 512.0_f64).powf(2.2) } else { 0.0 };
        let sampling = 2e-4 * ((245.0 / r).powf(2.2) - all_points).max(0.0);
        let mse = (sampling + 1e-4 * (gamma / 0.03).powf(1.1)) * (1.0 + self.richer);
        // The same for all parameters, as pixels that are hard are hard for all.
        let scatter = |b: u32| 1.0 + 0.2 * f64::from(b * 7919 % 16).mul_add(0.125, -0.9375);
        let seed = u64::from(p.resolution()).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ gamma.to_bits();
        let own = |b: u32| {
            let mixed = (seed ^ u64::from(b).wrapping_mul(0xbf58_476d_1ce4_e5b9)).wrapping_mul(0x94d0_49bb_1331_11eb);
            1.0 + self.own_scatter * (2.0 * (mixed >> 40) as f64 / f64::from(1 << 24) - 1.0)
        };
        let batch_mse = (0..batches).map(|b| mse * scatter(b) * own(b)).collect();
        Quality {
            views: if batches == 0 { Vec::new() } else { vec![ViewError { angle_deg: 10.0, batch_mse, ssim: None }] },
        }
    }
}

impl Evaluator for Response {
    fn step(&self) -> u64 {
        3
    }
    fn batches(&self) -> u32 {
        16
    }
    fn longest_side(&self) -> u32 {
        if self.irreducible { 0 } else { 512 }
    }
    async fn sizes(&mut self, params: &GenerationParams, gammas: &[f64]) -> Result<Vec<Cost>, TrialError> {
        self.marches += 1;
        self.takes_time().await;
        gammas.iter().map(|g| Ok(self.cost(&params.with_gamma(*g)?))).collect()
    }
    async fn time(&mut self, params: &GenerationParams) -> Result<Result<Duration, Invalid>, TrialError> {
        self.timed += 1;
        self.takes_time().await;
        Ok(Ok(self.cost(params).generation))
    }
    async fn evaluate(
        &mut self,
        all: &[GenerationParams],
        batches: Batches,
    ) -> Result<Vec<Result<Measurement, Invalid>>, TrialError> {
        let batches = batches.count(16);
        self.takes_time().await;
        self.measured += usize::from(batches == 0) * all.len();
        self.batches += batches as usize * all.len();
        Ok(all.iter().map(|p| Ok(Measurement { cost: self.cost(p), quality: self.quality(p, batches) })).collect())
    }
}

fn papers() -> Vec<GenerationParams> {
    SearchGrid::paper().candidates(&GenerationParams::vdi(1, 0.0).unwrap()).unwrap()
}

/// A search among some parameters without end.
async fn searched(response: &mut Response, contract: &Contract, all: Vec<GenerationParams>) -> SearchResult {
    search(response, SearchRequest::new(contract, &mut all.into()), |_| {}).await.unwrap()
}

/// Volumes and the VDIs of the paper's grid.
fn both() -> CandidateSet {
    CandidateSet::new(512, &Representation::ALL, &SearchGrid::paper(), &GenerationParams::vdi(1, 0.0).unwrap()).unwrap()
}

async fn exhaustive(contract: &Contract) -> Study {
    tune(&mut Response::default(), contract, &papers(), |_| {}).await.unwrap()
}

#[tokio::test]
async fn a_few_trials_find_what_thirteen_hundred_find() {
    for text in [
        "size <= 60kB",
        "size <= 150kB",
        "size <= 600kB",
        "time <= 8ms",
        "time+encoding <= 30ms, size <= 200kB",
        "psnr >= 36dB",
        "psnr >= 38dB, minimise time",
        "size <= 400kB, psnr >= 34dB, maximise q - 0.02 * sigma",
    ] {
        let contract: Contract = text.parse().unwrap();
        let all = exhaustive(&contract).await;
        let best = &all.rows[all.best.unwrap()];
        let mut response = Response::default();
        let found = searched(&mut response, &contract, papers()).await;
        let row = &found.study.rows[found.study.best.unwrap_or_else(|| panic!("{text}: {found:?}"))];
        assert!(contract.excess(&row.measured.cost, row.measured.quality.psnr_db()) <= 0.0, "{text} is kept");
        // Within 0.1 dB; of what is no decibels, within 2 %.
        let near = if contract.utility() == Utility::Quality { 0.1 } else { 0.02 * best.cost.abs() };
        assert!(row.cost - best.cost <= near, "{text}: {row:?}, but {best:?}");
        assert!(response.measured <= 24, "{text}: {} trials", response.measured);
        assert_eq!(response.marches, usize::from(text.contains("size") || text == "psnr >= 36dB"), "{text}");
        // Once something keeps a limit on generation, what breaks it is not encoded.
        let fast = |r: &&Trial| contract.excess(&r.measured.cost, f64::NAN) <= 0.0;
        let first = found.study.rows.iter().position(|r| fast(&r)).unwrap();
        assert!(text != "time <= 8ms" || (response.timed > 0 && found.study.rows[first..].iter().all(|r| fast(&r))));
        assert_eq!(row.measured.quality.batches(), 16, "{text}: the winner is measured on all pixels");
    }
}

#[tokio::test]
async fn where_no_volume_can_stand_for_the_step_none_is_tried() {
    let base = GenerationParams::vdi(1, 0.0).unwrap();
    let mut response = Response { irreducible: true, ..Response::default() };
    let of = |kinds: &[Representation]| CandidateSet::new(response.longest_side(), kinds, &SearchGrid::paper(), &base);
    let (all, none) = (of(&Representation::ALL), of(&[Representation::Volume]).unwrap_err());
    assert_eq!(all.unwrap().all(&mut response).await.unwrap(), papers());
    assert!(none.to_string().contains("second field") && none.to_string().contains("allow VDIs"), "{none}");
}

#[tokio::test]
async fn what_nothing_keeps_is_said_with_the_nearest() {
    let impossible = [
        "size <= 300B",
        "size <= 20kB, psnr >= 45dB",
        "time <= 0.01ms",
        "psnr >= 50dB",
        "psnr >= 52dB",
        "psnr >= 56dB",
    ];
    for text in impossible {
        let contract: Contract = text.parse().unwrap();
        let mut response = Response::default();
        let found = searched(&mut response, &contract, papers()).await;
        assert_eq!(found.study.best, None, "{text}");
        assert!(response.measured <= 14, "{text}: {} trials", response.measured);
        assert!(found.hope < 0.05, "{text}: {}", found.hope);
        let distance = |study: &Study| study.rows[study.nearest(&contract).unwrap()].distance(&contract);
        let least = distance(&exhaustive(&contract).await);
        assert!(distance(&found.study) - least < 0.05, "{text}: {} instead of {least}", distance(&found.study));
    }
}

#[tokio::test]
async fn a_margin_is_kept_where_something_has_it_and_given_up_where_nothing_has() {
    // At r = 160 generation takes 3.36 ms, at 192 4.5 ms.
    for (text, most_ms, most_r) in [
        ("time <= 20ms", 18.0, 480),
        ("time <= 3.5ms", 3.5, 160),
        // Nothing faster than r = 192 has so many decibels.
        ("time <= 4.6ms, psnr >= 34.3dB", 4.6, 192),
    ] {
        let contract: Contract = text.parse().unwrap();
        let mut response = Response::default();
        let found = search_with_margin(&mut response, SearchRequest::new(&contract, &mut papers().into()), |_| {})
            .await
            .unwrap();
        let row = &found.study.rows[found.study.best.unwrap_or_else(|| panic!("{text}: {found:?}"))];
        let ms = 1e3 * row.measured.cost.generation.as_secs_f64();
        assert!(ms <= most_ms && row.params.resolution() <= most_r, "{text}: {row:?}");
        assert!(row.cost.is_finite() && contract.cost(&row.measured) == row.cost, "{text}: {row:?}");
        let best = exhaustive(&contract.aim()).await;
        let best = if best.best.is_some() { best } else { exhaustive(&contract).await };
        assert!(row.cost - best.rows[best.best.unwrap()].cost <= 0.1, "{text}: {row:?}");
    }
    // Cut short, it is the best of what was tried that keeps the contract.
    let takes = Duration::from_millis(10);
    let mut response = Response { takes, ..Response::default() };
    let (contract, until) = ("time <= 3.5ms".parse().unwrap(), Instant::now() + takes * 7);
    let in_use = papers()[0];
    let mut all = papers().into();
    let request =
        SearchRequest { in_use: Some(&in_use), until: Some(until), ..SearchRequest::new(&contract, &mut all) };
    let found = search_with_margin(&mut response, request, |_| {}).await.unwrap();
    assert!(found.cut && found.study.best.is_some_and(|n| found.study.rows[n].cost < 0.0), "{found:?}");
}

#[tokio::test]
async fn timing_is_for_what_may_be_too_slow() {
    let timed = |text: &'static str, to_beat: bool| async move {
        let contract: Contract = text.parse().unwrap();
        let mut response = Response { dearer: 6, ..Response::default() };
        let kinds = if to_beat { &Representation::ALL[..] } else { &[Representation::Vdi] };
        let base = GenerationParams::vdi(1, 0.0).unwrap();
        let all = CandidateSet::new(512, kinds, &SearchGrid::paper(), &base).unwrap().all(&mut response).await.unwrap();
        let found = searched(&mut response, &contract, all.clone()).await;
        let row = found.study.best.map(|n| found.study.rows[n].clone()).unwrap();
        assert!(contract.cost(&row.measured).is_finite(), "{text}");
        let best = tune(&mut Response { dearer: 6, ..Response::default() }, &contract, &all, |_| {}).await.unwrap();
        assert!(row.cost - best.rows[best.best.unwrap()].cost <= 0.1, "{text}: {row:?}");
        response.timed
    };
    // A second is far beyond all of them; the first two are timed before the models know.
    assert!(timed("size <= 200kB, time <= 1s", false).await <= 2);
    assert!(timed("size <= 200kB, time <= 8ms", false).await > 2);
    // Volumes go first: no VDI is measured before it is timed.
    assert!(timed("time <= 8ms", true).await > 3);
}

#[tokio::test]
async fn parameters_in_use_are_measured_with_the_others() {
    let in_use = GenerationParams::vdi(333, 0.0123).unwrap();
    let contract = Contract::size(200_000);
    let mut all = papers().into();
    let request = SearchRequest { in_use: Some(&in_use), ..SearchRequest::new(&contract, &mut all) };
    let found = search(&mut Response::default(), request, |_| {}).await.unwrap();
    assert!(found.study.rows.iter().any(|r| r.params == in_use));
}

#[tokio::test]
async fn the_representation_that_serves_better_wins_and_the_other_is_soon_known_to_lose() {
    let contract: Contract = "size <= 150kB".parse().unwrap();
    let alone = {
        let mut response = Response::default();
        searched(&mut response, &contract, papers()).await;
        response.measured
    };
    for (dearer, winner) in [(-3, Representation::Volume), (3, Representation::Vdi)] {
        let mut response = Response { dearer, ..Response::default() };
        let all = both().all(&mut response).await.unwrap();
        assert_eq!(all.len(), 1300 + 7 * 28);
        let volumes: Vec<_> = all.iter().filter(|p| p.representation() == Representation::Volume).collect();
        assert_eq!(volumes.iter().map(|p| p.resolution()).max(), Some(512), "no more points than there are");
        let found = searched(&mut response, &contract, all.clone()).await;
        let best = &found.study.rows[found.study.best.unwrap()];
        assert_eq!(best.params.representation(), winner);
        let exhaustive = tune(&mut Response { dearer, ..Response::default() }, &contract, &all, |_| {}).await.unwrap();
        let best_of_all = &exhaustive.rows[exhaustive.best.unwrap()];
        assert!(best.cost - best_of_all.cost <= 0.1, "{best:?}, but {best_of_all:?}");
        assert!(response.measured <= 2 * alone + 8, "{} trials, {alone} for VDIs alone", response.measured);
    }
}

#[tokio::test]
async fn gammas_come_from_the_data_where_none_are_stated() {
    let base = GenerationParams::vdi(1, 0.0).unwrap();
    let vdis = [Representation::Vdi];
    let mut set = CandidateSet::new(512, &vdis, &SearchGrid::default(), &base).unwrap();
    let all = set.all(&mut Response::default()).await.unwrap();
    assert_eq!((all.len(), set.count()), (22 * 40, 22 * 40));
    assert!(set.spans(&all[77]) && !set.spans(&all[77].with_resolution(800).unwrap()));
    assert!(!set.spans(&GenerationParams::volume(all[77].resolution(), all[77].gamma()).unwrap()));
    let gammas: Vec<f64> = all[..40].iter().map(GenerationParams::gamma).collect();
    assert!(gammas.is_sorted() && gammas[0] < 0.001 && gammas[39] > 0.26, "{gammas:?}");
}

#[tokio::test]
async fn a_search_ends_in_time_with_the_best_so_far() {
    let contract = Contract::size(200_000);
    let in_use = *papers().iter().find(|p| p.resolution() == 160).unwrap();
    let takes = Duration::from_millis(10);
    for calls in [1, 2, 5, 12, 1_000_000] {
        let (mut response, mut first) = (Response { takes, ..Response::default() }, None);
        let progress = |row: &Trial| _ = first.get_or_insert(row.clone());
        let until = Instant::now() + calls * takes + takes / 2;
        let mut all = both();
        let request =
            SearchRequest { in_use: Some(&in_use), until: Some(until), ..SearchRequest::new(&contract, &mut all) };
        let found = search(&mut response, request, progress).await.unwrap();
        assert_eq!(found.left.is_none(), found.cut, "what is left is not known of a search cut short");
        assert_eq!(found.cut, calls <= 12, "{calls}: {found:?}");
        // A trial is two calls, none of which takes less; the first one is begun whenever there is time at all.
        assert!(response.calls <= calls.max(2), "{calls}: {}", response.calls);
        // A machine that stood still for so long has tried nothing.
        let Some(first) = first else { continue };
        assert_eq!(first.params, in_use, "what is in use comes first");
        let rows = &found.study.rows;
        let best = &rows[found.study.best.unwrap()];
        assert!(if calls > 12 { best.cost < first.cost } else { best.cost <= first.cost }, "{calls}: {best:?}");
        let other = rows.iter().filter(|r| r.params.representation() == Representation::Volume).count();
        assert!(if calls > 12 { other > 0 } else { other == 0 }, "{calls}: the representation in use comes first");
    }
    let (mut all, late) = (both(), Some(Instant::now() - Duration::from_secs(1)));
    let request = SearchRequest { in_use: Some(&in_use), until: late, ..SearchRequest::new(&contract, &mut all) };
    let none = search(&mut Response::default(), request, |_| {}).await.unwrap();
    assert!(none.study.rows.is_empty() && none.cut);
}
