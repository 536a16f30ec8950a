//! How soon a search has something good, on how few pixels, and how much of a limit on size it uses.

use super::{Response, exhaustive, papers, searched};
use crate::Contract;
use crate::evaluator::Measurement;
use crate::search::{CandidateSet, SearchGrid, SearchRequest, search};
use crate::tune::{Study, Trial, tune};
use lamina_model::{GenerationParams, Representation};
use std::time::Duration;
use tokio::time::Instant;

/// Twenty limits from 20 to 800 kB, evenly on a logarithmic scale.
fn limits() -> impl Iterator<Item = u64> {
    (0..20).map(|k| (20e3 * 40_f64.powf(f64::from(k) / 19.0)) as u64)
}

#[tokio::test]
async fn a_limit_on_size_is_filled_and_never_broken() {
    for limit in limits() {
        for kinds in [&[Representation::Vdi][..], &[Representation::Volume], &Representation::ALL] {
            let base = GenerationParams::vdi(1, 0.0).unwrap();
            let mut all = CandidateSet::new(512, kinds, &SearchGrid::default(), &base).unwrap();
            let (mut response, contract) = (Response::default(), Contract::size(limit));
            let found = search(&mut response, SearchRequest::new(&contract, &mut all), |_| {}).await.unwrap();
            let best = &found.study.rows[found.study.best.unwrap()];
            let share = best.measured.cost.size_bytes as f64 / limit as f64;
            assert!((0.95..=1.0).contains(&share), "{limit} {kinds:?}: {share} by {best:?}");
            assert_eq!(best.measured.quality.batches(), 16);
            let digits = format!("{:.3e}", best.params.gamma()).parse::<f64>().unwrap();
            assert_eq!(digits, best.params.gamma(), "a person can write it down");
            assert!(response.measured <= 24, "{limit} {kinds:?}: {} trials", response.measured);
        }
    }
}

#[tokio::test]
async fn a_limit_is_filled_only_where_bytes_buy_what_is_wanted() {
    // The optimum lies inside: a decibel more costs more bytes than it is worth. And sizes jump over the limit.
    let contract: Contract = "size <= 400kB, maximise q - 0.2 * sigma".parse().unwrap();
    let all = exhaustive(&contract).await;
    let found = searched(&mut Response::default(), &contract, papers()).await;
    let cost = |study: &Study| study.rows[study.best.unwrap()].cost;
    assert!(cost(&found.study) <= cost(&all) + 0.02 * cost(&all).abs());
    assert!(found.study.rows[found.study.best.unwrap()].measured.cost.size_bytes < 200_000);
    let mut response = Response { jump: 0.02, ..Response::default() };
    let base = GenerationParams::vdi(1, 0.0).unwrap();
    let volumes = CandidateSet::new(512, &[Representation::Volume], &SearchGrid::paper(), &base).unwrap();
    let volumes = volumes.clone().all(&mut response).await.unwrap();
    let contract = Contract::size(800_000);
    let found = searched(&mut response, &contract, volumes.clone()).await;
    let best = &found.study.rows[found.study.best.unwrap()];
    let all = tune(&mut Response { jump: 0.02, ..Response::default() }, &contract, &volumes, |_| {}).await.unwrap();
    assert!(best.measured.cost.size_bytes <= 800_000 && best.cost - cost(&all) <= 0.1, "{best:?}");
    assert!(response.measured <= 24, "{} trials", response.measured);
}

#[tokio::test]
async fn the_first_or_second_quality_measured_is_within_3_db_of_the_best() {
    for limit in limits() {
        for kinds in [&[Representation::Vdi][..], &Representation::ALL] {
            let base = GenerationParams::vdi(1, 0.0).unwrap();
            let mut all = CandidateSet::new(512, kinds, &SearchGrid::default(), &base).unwrap();
            let (contract, mut kept) = (Contract::size(limit), Vec::new());
            let progress =
                |row: &Trial| kept.extend(Some(row.measured.quality.psnr_db()).filter(|_| row.cost.is_finite()));
            let found =
                search(&mut Response::default(), SearchRequest::new(&contract, &mut all), progress).await.unwrap();
            let best = found.study.rows[found.study.best.unwrap()].measured.quality.psnr_db();
            let soon = kept.iter().take(2).copied().fold(0.0, f64::max);
            assert!(best - soon <= 3.0, "{limit} {kinds:?}: {kept:?}, but {best} in the end");
        }
    }
}

#[tokio::test]
async fn the_range_of_vdis_is_looked_for_only_after_the_volumes() {
    let base = GenerationParams::vdi(1, 0.0).unwrap();
    let contract = Contract::size(200_000);
    let takes = Duration::from_millis(10);
    let mut all = CandidateSet::new(512, &Representation::ALL, &SearchGrid::default(), &base).unwrap();
    let mut response = Response { takes, ..Response::default() };
    // A march, an encoding and a quality, and no time for more.
    let request = SearchRequest { until: Some(Instant::now() + takes * 4), ..SearchRequest::new(&contract, &mut all) };
    let found = search(&mut response, request, |_| {}).await.unwrap();
    assert_eq!(response.marches, 1, "that of the volumes");
    assert!(found.cut && found.study.best.is_some(), "{found:?}");
    // Nor again on the next step where there is no time for it.
    let mut response = Response { takes, ..Response::default() };
    search(&mut response, SearchRequest::new(&contract, &mut all), |_| {}).await.unwrap();
    assert_eq!(response.marches, 2);
    let next = CandidateSet::new(512, &[Representation::Vdi], &SearchGrid::default(), &base).unwrap();
    let (mut next, mut later) = (next.with_range_of(&all), Response { takes, ..Response::default() });
    let request = SearchRequest { until: Some(Instant::now() + takes * 3), ..SearchRequest::new(&contract, &mut next) };
    search(&mut later, request, |_| {}).await.unwrap();
    assert!(later.marches <= 1, "only that of the sizes");
}

#[tokio::test]
async fn trials_of_an_earlier_step_decide_the_first_and_are_no_results() {
    let contract = Contract::size(200_000);
    let mut before = Response { richer: 0.1, ..Response::default() };
    let earlier = searched(&mut before, &contract, papers()).await.study;
    let (best, rows) = (earlier.rows[earlier.best.unwrap()].params, &earlier.rows);
    let (mut response, mut order) = (Response::default(), Vec::new());
    let mut all = papers().into();
    let request = SearchRequest { carried: rows, ..SearchRequest::new(&contract, &mut all) };
    let found = search(&mut response, request, |row| order.push(row.clone())).await.unwrap().study;
    assert_eq!(order[0].params, best, "the best of the earlier step comes first");
    // Another step has other figures: none of the earlier ones is among the results.
    for row in &found.rows {
        assert_eq!(row.measured.cost, response.cost(&row.params), "{row:?}");
    }
    let alone = searched(&mut Response::default(), &contract, papers()).await.study;
    let cost = |study: &Study| study.rows[study.best.unwrap()].cost;
    assert!(cost(&found) - cost(&alone) <= 0.1, "{} and {}", cost(&found), cost(&alone));
    assert!(response.measured <= before.measured, "{} trials instead of {}", response.measured, before.measured);
    // What broke the contract there is no choice.
    let too_large: Vec<Trial> = rows.iter().filter(|r| r.cost == f64::INFINITY).cloned().collect();
    let request = SearchRequest { carried: &too_large, ..SearchRequest::new(&contract, &mut all) };
    assert!(search(&mut Response::default(), request, |_| {}).await.unwrap().study.best.is_some());
}

#[tokio::test]
async fn few_pixels_decide_where_they_can() {
    // In the made-up response every batch tells the same of a difference: all but the best stay with the fewest.
    for limit in limits().skip(3).step_by(4) {
        let found = searched(&mut Response::default(), &Contract::size(limit), papers()).await.study;
        let batches = |r: &Trial| r.measured.quality.batches();
        let best = &found.rows[found.best.unwrap()];
        assert_eq!(batches(best), 16);
        let full = found.rows.iter().filter(|r| batches(r) == 16).count();
        assert!(full <= 3, "{limit}: {full} trials on all pixels");
        assert!(found.rows.iter().all(|r| [0, 2, 8, 16].contains(&batches(r))));
        assert!(found.rows.iter().any(|r| batches(r) == 2));
    }
}

#[tokio::test]
async fn more_pixels_are_asked_for_where_few_do_not_decide() {
    // Batches of one trial differ from another's by up to 15 % in squared error: two of them by 0.5 dB, all by 0.15.
    let all_pixels = |row: &Trial| row.measured.quality.batches() == 16;
    let (mut measured, mut whole_study) = (0, 0);
    for limit in limits().skip(3).step_by(2) {
        let mut response = Response { own_scatter: 0.15, ..Response::default() };
        let contract = Contract::size(limit);
        let found = searched(&mut response, &contract, papers()).await.study;
        let best = &found.rows[found.best.unwrap()];
        assert!(all_pixels(best));
        // None of the other trials is better by more than all pixels can tell.
        for row in found.rows.iter().filter(|r| r.measured.quality.batches() > 0) {
            let whole = Measurement { quality: response.quality(&row.params, 16), ..row.measured.clone() };
            assert!(best.cost - contract.cost(&whole) <= 0.15, "{limit}: {row:?}, but {best:?}");
        }
        let batches = found.rows.iter().map(|r| r.measured.quality.batches()).filter(|b| *b > 0);
        measured += batches.clone().sum::<usize>();
        whole_study += 16 * batches.count();
    }
    assert!(measured < whole_study, "{measured} batches of {whole_study}");
}
