//! What a tick on clay costs, by points of the tool and how deep it is.
//!
//! `cargo bench -p bench --bench clay` measures; `-- --test` runs each once. For clean figures:
//! `chrt -r 20`, on a processor of its own.

use bench::contact::clay::Turning;
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};

fn touching(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("tick on clay");
    for n_points in [1, 1000, 4000] {
        for depth_mm in [-1.0, 0.5, 3.0, 20.0] {
            let Ok(mut turning) = Turning::new(n_points, depth_mm * 1e-3) else { continue };
            let contacts = turning.tick().contacts;
            let id = BenchmarkId::new(
                format!("{n_points} points"),
                format!("{depth_mm} mm deep, {contacts} touch"),
            );
            group.bench_function(id, |bencher| bencher.iter(|| turning.tick()));
        }
    }
    group.finish();
}

criterion_group!(benches, touching);
criterion_main!(benches);
