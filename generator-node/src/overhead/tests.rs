//! The controller beside simulated simulations.

use super::*;

/// A simulation whose steps take 100 ms alone, and `cost` of that longer per unit of the node's share beside it; a push takes
/// `push`. Now and then something else makes one a tenth longer.
struct Simulated {
    controller: Controller,
    now: Instant,
    cost: f64,
    push: Duration,
    paused: bool,
    throttle: f64,
    /// Seconds of pauses, and of all.
    time: [f64; 2],
}

impl Simulated {
    fn new(limit: f64, cost: f64) -> Self {
        let now = Instant::now();
        let controller = Controller::new(Some(limit), now);
        let throttle = controller.coupling.throttle;
        Self { controller, now, cost, push: Duration::ZERO, paused: false, throttle, time: [0.0; 2] }
    }

    /// By how much the steps took longer than alone.
    fn run(&mut self, pushes: u32) -> f64 {
        let (mut sum, mut steps) = (0.0, 0);
        for _ in 0..pushes {
            let Coupling { cheaper, cadence, .. } = self.controller.coupling;
            let beside = if self.paused { 0.0 } else { self.cost * self.throttle * 0.5_f64.powi(cheaper as i32) };
            let interval = Duration::from_secs_f64(0.1 * (1.0 + beside)) + self.push / cadence;
            let longer = (steps..steps + cadence).filter(|step| step % 7 == 0).count();
            let noise = 1.0 + 0.1 * longer as f64 / f64::from(cadence);
            self.now += interval * cadence;
            self.time[usize::from(!self.paused)] += interval.as_secs_f64() * f64::from(cadence);
            sum += (interval.as_secs_f64() / 0.1 - 1.0) * f64::from(cadence);
            steps += cadence;
            match self.controller.step(interval.mul_f64(noise), self.push, self.now) {
                Some(Change::Pause(_)) => self.paused = true,
                Some(Change::Work(throttle)) => (self.paused, self.throttle) = (false, throttle),
                None => {}
            }
        }
        sum / f64::from(steps)
    }
}

#[test]
fn the_limit_is_kept_by_cadence_first_and_pauses_take_a_tenth_of_the_time() {
    let mut simulated = Simulated::new(0.05, 0.4);
    simulated.run(400);
    simulated.time = [0.0; 2];
    let overhead = simulated.run(2000);
    assert!((0.015..=0.05).contains(&overhead), "{overhead}");
    let Coupling { overhead: Some(measured), throttle, cheaper, .. } = simulated.controller.coupling else { panic!() };
    assert!((0.02..=0.05).contains(&measured) && cheaper == 0);
    assert!((throttle * 0.4 - measured).abs() < 0.02);
    let paused = simulated.time[0] / (simulated.time[0] + simulated.time[1]);
    assert!((0.05..0.15).contains(&paused), "{paused}");
}

/// The node has all of its share, and what is measured is the noise.
fn is_free(simulated: &Simulated) -> bool {
    let Coupling { overhead, throttle, cadence, cheaper } = simulated.controller.coupling;
    overhead.is_some_and(|o| o < 0.02) && (throttle, cadence, cheaper) == (1.0, 1, 0)
}

#[test]
fn a_simulation_on_cores_of_its_own_costs_the_node_nothing() {
    let mut simulated = Simulated::new(0.05, 0.0);
    simulated.run(500);
    assert!(is_free(&simulated), "{:?}", simulated.controller.coupling);
    let mut unlimited = Simulated::new(0.05, 0.5);
    unlimited.controller = Controller::new(None, unlimited.now);
    unlimited.run(500);
    assert_eq!(unlimited.controller.coupling.overhead, None, "without a limit nothing pauses");
}

#[test]
fn where_cadence_is_not_enough_steps_become_cheaper_and_dear_again_when_there_is_room() {
    let mut simulated = Simulated::new(0.03, 3.0);
    simulated.run(3000);
    let coupling = simulated.controller.coupling;
    assert!(coupling.cheaper > 0 && coupling.throttle <= 0.1, "{coupling:?}");
    let overhead = simulated.run(500);
    assert!(overhead <= 0.035, "{overhead}");
    simulated.cost = 0.0;
    simulated.run(6000);
    assert!(is_free(&simulated), "{:?}", simulated.controller.coupling);
}

#[test]
fn pushes_that_cost_too_much_by_themselves_become_rarer() {
    let mut simulated = Simulated::new(0.05, 0.0);
    simulated.push = Duration::from_millis(20);
    simulated.run(1000);
    let overhead = simulated.run(1000);
    assert!((0.01..=0.06).contains(&overhead), "a fifth of a step each: {overhead}");
    assert!((2..=16).contains(&simulated.controller.coupling.cadence));
}

#[test]
fn pushes_become_rarer_before_any_pause_has_told_what_the_node_costs() {
    for (push_ms, cadence) in [(2, 1), (4, 2), (15, 8), (90, 16)] {
        let mut simulated = Simulated::new(0.05, 0.0);
        simulated.push = Duration::from_millis(push_ms);
        simulated.run(1 + PUSHES as u32);
        let coupling = simulated.controller.coupling;
        assert_eq!((coupling.cadence, coupling.overhead), (cadence, None), "{push_ms} ms of 100");
    }
    // As many again, when there is room, whatever else the node costs.
    for cost in [0.0, 0.11] {
        let mut simulated = Simulated::new(0.05, cost);
        simulated.push = Duration::from_millis(15);
        simulated.run(1 + PUSHES as u32);
        assert_eq!(simulated.controller.coupling.cadence, 8);
        simulated.push = Duration::from_micros(100);
        simulated.run(40);
        assert_eq!(simulated.controller.push_cadence, 1);
    }
    // At the border it stays.
    let mut simulated = Simulated::new(0.05, 0.0);
    let mut changes = 0;
    for n in 0..2000 {
        simulated.push = Duration::from_micros(2400 + 100 * (n * 7 % 3));
        let before = simulated.controller.push_cadence;
        simulated.run(1);
        changes += u32::from(simulated.controller.push_cadence != before);
    }
    assert!(changes <= 1, "{changes}");
}

#[tokio::test(start_paused = true)]
async fn a_simulation_that_falls_silent_in_a_pause_holds_the_node_up_for_a_moment_only() {
    let share = CpuShare::new(lamina_compute::CpuLimit::default()).unwrap();
    let overhead = Overhead::new(share.clone());
    overhead.limit(Some(0.05));
    let step = Duration::from_millis(50);
    // One that is skipped, and those of a phase of work.
    for _ in 0..=WORK_STEPS {
        assert!(share.try_acquire(lamina_compute::Priority::LiveStep).is_some());
        tokio::time::advance(step).await;
        overhead.step(step, Duration::ZERO);
    }
    assert!(share.try_acquire(lamina_compute::Priority::LiveStep).is_none(), "a pause");
    let begun = Instant::now();
    drop(share.acquire(lamina_compute::Priority::LiveStep).await);
    assert!(begun.elapsed() < Duration::from_secs(1));
}
