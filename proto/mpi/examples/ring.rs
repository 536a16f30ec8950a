//! Every process sends messages of many sizes to every other, and checks what it gets: for `mpiexec -n P ring`.

use std::time::Duration;

/// Bytes of a message, none of them by accident.
fn message(from: u32, to: u32, n: u64) -> Vec<u8> {
    let length = [0, 1, 8, 1000, 3_000_000][n as usize % 5];
    (0..length).map(|k| (k as u64 * 31 + u64::from(from) * 7 + u64::from(to) * 3 + n) as u8).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    const ROUNDS: u64 = 20;
    let (outbox, inbox) = lamina_mpi::join(None)?;
    let (me, size) = (outbox.rank(), outbox.size());
    for n in 0..ROUNDS {
        for to in 0..size {
            outbox.send(to, message(me, to, n))?;
        }
    }
    let mut next = vec![0; size as usize];
    for _ in 0..ROUNDS * u64::from(size) {
        let (from, bytes) = inbox.receive(Duration::from_secs(60))?;
        let n = &mut next[from as usize];
        if bytes != message(from, me, *n) {
            return Err(format!("message {n} from {from} to {me} is another one").into());
        }
        *n += 1;
    }
    println!("rank {me} of {size}: all {} messages came in order", ROUNDS * u64::from(size));
    drop(outbox);
    inbox.leave();
    Ok(())
}
