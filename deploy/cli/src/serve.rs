//! `lamina serve`: the nodes in this process, for simulations that connect by themselves.

use crate::cli;
use crate::nodes::{Nodes, Setup};
use crate::scene_file;
use crate::terminal::{Shown, progress};
use crate::watch::{share, tuning};
use std::time::Duration;

/// How often the terminal is told what is new.
const POLL: Duration = Duration::from_millis(100);

/// `lamina serve`.
pub fn serve(arguments: &cli::Serve) -> anyhow::Result<()> {
    let options = &arguments.nodes;
    let scene = options.scene.as_deref().map(scene_file::whole).transpose()?;
    let (samples, tuning) = tuning(options);
    let nodes = Nodes::start(Setup {
        listen: arguments.listen,
        viewer: options.viewer,
        insecure: options.insecure,
        store: options.out.clone(),
        memory_bytes: arguments.memory << 20,
        samples,
        backend: options.backend,
        step_voxels: scene.as_ref().map_or(lamina_tuner::Config::default().step_voxels, |s| s.step_voxels),
        scene,
        params: None,
        share: share(options)?,
        measure_all: false,
        tuning: Some(tuning),
    })?;
    let stopped = nodes.stopped();
    say!("simulations connect to {}; open http://{}/   (Ctrl-C ends)", nodes.generator, nodes.viewer);
    let bar = progress(None, false);
    let mut run = nodes.store.run().map(|run| run.id);
    let mut shown = Shown::new(nodes.store.newest_step(), true);
    while !stopped() {
        if let Some(begun) = nodes.store.run().filter(|r| Some(&r.id) != run.as_ref()) {
            let [x, y, z] = begun.dims;
            say!("watching {} ({}), {x} x {y} x {z}", begun.name, begun.field);
            run = Some(begun.id);
            shown = Shown::new(None, false);
        }
        shown.show_new(&nodes, &bar, None)?;
        std::thread::sleep(POLL);
    }
    nodes.stop();
    Ok(())
}
