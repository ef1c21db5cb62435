//! Runs several futures of one task to completion. They may borrow, unlike spawned tasks.

use std::future::poll_fn;
use std::pin::Pin;
use std::task::Poll;

/// Runs all of them concurrently; there are few, so each wake-up polls all.
pub(super) async fn all<'a, T>(
    futures: impl IntoIterator<Item = impl Future<Output = T> + 'a>,
) -> Vec<T> {
    let mut running: Vec<Pin<Box<dyn Future<Output = T> + 'a>>> = Vec::new();
    for future in futures {
        running.push(Box::pin(future));
    }
    let mut results: Vec<Option<T>> = running.iter().map(|_| None).collect();
    poll_fn(|context| {
        let mut pending = false;
        for (future, result) in running.iter_mut().zip(&mut results) {
            if result.is_none() {
                match future.as_mut().poll(context) {
                    Poll::Ready(done) => *result = Some(done),
                    Poll::Pending => pending = true,
                }
            }
        }
        if pending {
            Poll::Pending
        } else {
            Poll::Ready(())
        }
    })
    .await;
    results.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::sync::Barrier;

    #[tokio::test]
    async fn all_run_at_once_and_answer_in_order() {
        let together = Barrier::new(3);
        let together = &together;
        let answers = all((0..3).map(|number| async move {
            together.wait().await;
            number
        }));
        assert_eq!(answers.await, [0, 1, 2]);
    }
}
