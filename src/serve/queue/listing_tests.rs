//! Listings of many jobs.

use super::*;
use crate::serve::job::State;

async fn store(jobs: i64) -> (tempfile::TempDir, Store) {
    let folder = tempfile::tempdir().expect("a folder");
    let store = Store::open(&folder.path().join("q.db")).await.expect("opened");
    let mut tx = store.begin().await.expect("begun");
    sqlx::query("INSERT INTO data_set (id, path, kind, name, stamp, created_at, updated_at) VALUES (1, '/a', 'file', 'a', '', 0, 0)")
        .execute(&mut *tx)
        .await
        .expect("a data set");
    sqlx::query(
        "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < ?) \
         INSERT INTO job (id, data_set, name, source, revision, content_key, state, options, points, bytes, \
           error, created_at, started_at, updated_at, finished_at) \
         SELECT i, 1, 'Tile_' || (i % 50), '/in/' || i || '.las', 1, 'k' || i, \
           CASE i % 4 WHEN 0 THEN 'failed' WHEN 1 THEN 'queued' ELSE 'done' END, '{}', i % 7, i % 5, \
           CASE i % 4 WHEN 0 THEN '/in/' || i || '.las: broken in ' || (i % 3) END, \
           i, CASE WHEN i % 4 <> 1 THEN 0 END, i, CASE WHEN i % 4 <> 1 THEN i % 11 END FROM n",
    )
    .bind(jobs)
    .execute(&mut *tx)
    .await
    .expect("jobs");
    tx.commit().await.expect("kept");
    (folder, store)
}

/// Walks through all pages, forward and back, and gives the numbers on them.
async fn walk(store: &Store, listing: &Listing, limit: i64) -> Vec<JobId> {
    let (mut ids, mut pages, mut place) = (vec![], vec![], None);
    loop {
        let page = store.listing(listing, place.as_ref(), limit).await.expect("a page");
        let on_it: Vec<JobId> = page.jobs.iter().map(|job| job.id).collect();
        assert_eq!(page.previous.is_some(), !pages.is_empty());
        ids.extend(&on_it);
        pages.push(on_it);
        let Some(next) = page.next else { break };
        // As a link has it.
        place = ListingCursor::parse(&next.to_text());
        assert_eq!(place.as_ref(), Some(&next));
    }
    let mut back = store.listing(listing, place.as_ref(), limit).await.expect("the last page");
    for expected in pages.iter().rev().skip(1) {
        back = store.listing(listing, back.previous.as_ref(), limit).await.expect("a page");
        assert_eq!(back.jobs.iter().map(|job| job.id).collect::<Vec<_>>(), *expected);
    }
    assert!(back.previous.is_none() || pages.len() == 1, "nothing before the first");
    ids
}

#[tokio::test]
async fn pages_hold_every_job_once_in_every_order() {
    let (_folder, store) = store(203).await;
    for sort in Sort::ALL {
        for ascending in [true, false] {
            for (shown, search, count) in [
                (None, "", 203),
                (Some(Shown::In(State::Done)), "", 102),
                (None, "tile_1", 45),
                (Some(Shown::In(State::Failed)), "TILE_12", 1 + 1),
                (None, "e_%", 0),
            ] {
                let listing = Listing { shown, search: search.into(), sort, ascending };
                let ids = walk(&store, &listing, 10).await;
                let mut unique = ids.clone();
                unique.sort_unstable();
                unique.dedup();
                assert_eq!((unique.len(), ids.len()), (count, count), "{listing:?}");
                let counts = store.shown_counts().await.expect("counts");
                for limit in [10, 1_000] {
                    let page = store.listing(&listing, None, limit).await.expect("a page");
                    let total = store.total(&listing, &page, &counts).await.expect("a total");
                    assert_eq!(total, count as i64, "{limit}");
                }
            }
        }
    }
}

#[tokio::test]
async fn names_sort_by_name_and_durations_by_length() {
    let (_folder, store) = store(60).await;
    let by = |sort| Listing { sort, ascending: true, ..Listing::default() };
    let names = store.listing(&by(Sort::Name), None, 100).await.expect("a page").jobs;
    assert!(names.windows(2).all(|two| (&two[0].name, two[0].id) < (&two[1].name, two[1].id)));
    let took = store.listing(&by(Sort::Took), None, 100).await.expect("a page").jobs;
    let took: Vec<i64> = took.iter().map(|job| job.finished_at.unwrap_or(-1)).collect();
    assert!(took.is_sorted(), "{took:?}");
}

#[tokio::test]
async fn reasons_are_counted_without_the_names_of_files() {
    let (_folder, store) = store(24).await;
    let reasons = store.reasons(Shown::In(State::Failed), 10).await.expect("reasons");
    let [all] = &reasons[..] else { panic!("{reasons:?}") };
    assert_eq!((all.jobs, all.example, all.text.starts_with("…: broken in ")), (6, 24, true));
    let jobs = store.failed_for(Shown::In(State::Failed), &all.key, 100).await.expect("jobs");
    assert_eq!(jobs, [24, 20, 16, 12, 8, 4]);
    assert!(store.failed_for(Shown::In(State::Failed), "another", 100).await.expect("jobs").is_empty());
}

#[tokio::test]
async fn dismissed_jobs_are_news_again_once_something_happens() {
    let (_folder, store) = store(8).await;
    assert_eq!(store.dismiss(&[1, 2, 4, 8, 99], 5).await.expect("done"), 2, "only failed ones");
    let count = |counts: &[(Shown, i64)], shown| {
        counts.iter().find(|(s, _)| *s == shown).map(|(_, jobs)| *jobs).expect("counted")
    };
    let counts = store.shown_counts().await.expect("counts");
    assert_eq!((count(&counts, Shown::Dismissed), count(&counts, Shown::In(State::Failed))), (2, 0));
    assert_eq!(store.listing(&Listing::default(), None, 50).await.expect("a page").jobs.len(), 6);
    assert_eq!(store.order_all(&[4, 2], crate::serve::job::Event::Retry, 6).await.expect("ordered"), 2);
    let counts = store.shown_counts().await.expect("counts");
    assert_eq!((count(&counts, Shown::Dismissed), count(&counts, Shown::In(State::Queued))), (1, 4));
}

#[tokio::test]
async fn the_mode_outlives_the_daemon() {
    use crate::serve::queue::QueueMode;
    let (folder, store) = store(1).await;
    assert_eq!(store.mode().await.expect("a mode"), QueueMode::Run);
    store.set_mode(QueueMode::Drain).await.expect("set");
    store.close().await;
    let store = Store::open(&folder.path().join("q.db")).await.expect("opened");
    assert_eq!(store.mode().await.expect("a mode"), QueueMode::Drain);
}

#[tokio::test]
async fn a_page_is_found_in_indexes_alone() {
    let (_folder, store) = store(50).await;
    for sql in [
        "SELECT id FROM job WHERE shown <> 'dismissed' ORDER BY id DESC LIMIT 10",
        "SELECT id FROM job INDEXED BY job_listed WHERE shown = 'done' ORDER BY id DESC LIMIT 10",
        "SELECT id FROM job INDEXED BY job_listed WHERE shown <> 'dismissed' AND name LIKE '%a%' ORDER BY name DESC, id DESC LIMIT 10",
        "SELECT shown, count(*) FROM job INDEXED BY job_listed GROUP BY shown",
        "SELECT finished_at / 3600000 AS hour, count(*), total(points) FROM job INDEXED BY job_listed \
         WHERE shown IN ('done', 'replaced') AND finished_at >= 1 GROUP BY hour",
    ] {
        let rows = sqlx::query(sqlx::AssertSqlSafe(format!("EXPLAIN QUERY PLAN {sql}")))
            .fetch_all(&store.readers)
            .await
            .expect("a plan");
        let plan: Vec<String> = rows.iter().map(|row| row.try_get("detail").expect("text")).collect();
        let fine = plan.iter().any(|line| line.contains("INDEX job_listed"))
            || sql.contains("<> 'dismissed' ORDER BY id");
        assert!(fine, "{sql}: {plan:?}");
    }
}
