//! The share on a paused clock: who is granted what, and when.

use super::*;

fn share(cores: f64) -> CpuShare {
    CpuShare::on(cores, 1, Scheduling::Normal).unwrap()
}

/// Work that is said to have taken so long.
fn spend(permit: &Permit, secs: f64) {
    permit.share.spend(permit.priority, &[(Activity::Generate, Duration::from_secs_f64(secs))]);
}

#[tokio::test(start_paused = true)]
async fn work_is_admitted_at_the_rate_granted() {
    let (share, begun) = (share(0.5), Instant::now());
    for _ in 0..40 {
        let permit = share.acquire(Priority::Trial).await;
        spend(&permit, 0.25);
    }
    // 10 s of work at half a core, of which the bucket held half a second.
    let took = begun.elapsed().as_secs_f64();
    assert!((took - (10.0 - 0.25 - 0.5) / 0.5).abs() < 1.0, "{took} s");
    assert_eq!(share.usage().admitted(Priority::Trial), 40);
}

#[tokio::test(start_paused = true)]
async fn a_picture_waits_for_no_trial_and_trials_go_on_beside_pictures_without_end() {
    let share = share(1.0);
    let trial = share.acquire(Priority::FirstTrial).await;
    spend(&trial, 30.0);
    // A second of drawing beside it at once, while the trial's debt is waited for.
    let begun = Instant::now();
    let picture = share.acquire(Priority::Picture).await;
    assert_eq!(begun.elapsed(), Duration::ZERO);
    drop((trial, picture));
    sleep(Duration::from_secs(60)).await;
    let pages = tokio::spawn({
        let share = share.clone();
        async move {
            loop {
                let picture = share.acquire(Priority::Picture).await;
                spend(&picture, 0.05);
                drop(picture);
                tokio::task::yield_now().await;
            }
        }
    });
    let begun = Instant::now();
    for _ in 0..20 {
        spend(&share.acquire(Priority::FirstTrial).await, 0.2);
    }
    // 4 s of trials within the four tenths that pictures leave.
    let took = begun.elapsed().as_secs_f64();
    assert!((5.0..13.0).contains(&took), "{took} s");
    pages.abort();
}

#[tokio::test(start_paused = true)]
async fn live_steps_go_on_beside_a_trial_and_while_it_is_paid_for_and_wait_for_a_first_study() {
    let share = share(1.0);
    let trial = share.acquire(Priority::Trial).await;
    let begun = Instant::now();
    drop(share.acquire(Priority::LiveStep).await);
    assert_eq!(begun.elapsed(), Duration::ZERO, "beside a trial at work");
    spend(&trial, 31.0);
    drop(trial);
    // The next trial waits for the debt of 30 s, and live steps of a quarter of the rate before it for nothing.
    let next = tokio::spawn({
        let share = share.clone();
        async move { drop(share.acquire(Priority::Trial).await) }
    });
    let begun = Instant::now();
    for _ in 0..10 {
        spend(&share.acquire(Priority::LiveStep).await, 0.25);
        sleep(Duration::from_millis(250)).await;
    }
    let took = begun.elapsed().as_secs_f64();
    assert!((7.0..11.0).contains(&took), "2.5 s of steps at a quarter of a core: {took} s");
    let begun = Instant::now();
    next.await.unwrap();
    assert!(begun.elapsed().as_secs_f64() > 20.0, "what the steps took is owed, too");
    // A first study is what everybody waits for, a step for a second.
    let trial = share.acquire(Priority::FirstTrial).await;
    let begun = Instant::now();
    drop(share.acquire(Priority::LiveStep).await);
    assert!((1.0..1.3).contains(&begun.elapsed().as_secs_f64()), "{:?}", begun.elapsed());
    drop(trial);
    spend(&share.acquire(Priority::FirstTrial).await, 11.0);
    let next = tokio::spawn({
        let share = share.clone();
        async move { share.acquire(Priority::FirstTrial).await }
    });
    tokio::task::yield_now().await;
    let begun = Instant::now();
    let step = tokio::spawn({
        let share = share.clone();
        async move { share.acquire(Priority::LiveStep).await }
    });
    drop(next.await.unwrap());
    assert!(begun.elapsed().as_secs_f64() > 5.0);
    step.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn what_does_not_fit_is_skipped_and_counted_and_who_gives_up_leaves_no_gap() {
    let share = share(0.5);
    let first = share.try_acquire(Priority::Quality).unwrap();
    assert!(share.try_acquire(Priority::Quality).is_none(), "somebody works");
    spend(&first, 2.0);
    drop(first);
    assert!(share.try_acquire(Priority::Quality).is_none(), "no tokens");
    assert_eq!(share.usage().skipped(Priority::Quality), 2);
    let impatient = tokio::time::timeout(Duration::from_millis(10), share.acquire(Priority::Trial)).await;
    assert!(impatient.is_err() && share.waiting() == 0);
    share.hold(Duration::from_secs(70));
    let held = tokio::time::timeout(Duration::from_secs(60), share.acquire(Priority::LiveStep)).await;
    assert!(held.is_err(), "a pause");
    let begun = Instant::now();
    drop(share.acquire(Priority::LiveStep).await);
    assert!(begun.elapsed() <= Duration::from_secs(11), "it ends by itself");
    share.hold(Duration::from_secs(70));
    share.hold(Duration::ZERO);
    assert!(share.try_acquire(Priority::LiveStep).is_some());
}

#[tokio::test(start_paused = true)]
async fn a_throttled_share_admits_less() {
    let share = share(1.0);
    share.throttle(0.1);
    drop(share.acquire(Priority::Trial).await);
    let begun = Instant::now();
    for _ in 0..10 {
        spend(&share.acquire(Priority::Trial).await, 0.1);
    }
    let took = begun.elapsed().as_secs_f64();
    assert!((7.0..11.0).contains(&took), "{took} s");
    assert_eq!(share.throttled_to(), 0.1);
}

#[tokio::test]
async fn work_runs_on_the_nodes_own_threads_and_its_time_is_counted_by_activity() {
    let share = share(1.0);
    let work = |laps: &mut Laps| {
        let begun = crate::cpu::threads::thread_cpu_time();
        while crate::cpu::threads::thread_cpu_time() - begun < Duration::from_millis(5) {}
        laps.lap(Activity::Encode);
        std::thread::current().name().unwrap().to_owned()
    };
    let permit = share.acquire(Priority::Trial).await;
    assert_eq!(permit.run(Activity::Generate, work).await.unwrap(), "kernel-0");
    let usage = share.usage();
    assert!(usage.cpu(Activity::Encode) >= Duration::from_millis(5));
    assert!(usage.cpu(Activity::Generate) < usage.cpu(Activity::Encode));
    let panicked = share.acquire(Priority::LiveStep).await.run(Activity::Draw, |_| panic!("made up")).await;
    assert!(panicked.is_err());
    drop(share.acquire(Priority::LiveStep).await);
}
