//! A queue with many jobs, put into the database at once: nothing of them was ever
//! converted, and nothing is.

use std::path::Path;

use lodestone::serve::queue::Store;
use sqlx::Connection;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};

/// Runs these statements on a new queue.
fn write(root: &Path, statements: &[(&'static str, Vec<String>)]) {
    std::fs::create_dir_all(root).expect("made");
    let path = root.join("lodestone.db");
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    runtime.block_on(async {
        Store::open(&path).await.expect("opened").close().await;
        let options = SqliteConnectOptions::new().filename(&path);
        let mut database = SqliteConnection::connect_with(&options).await.expect("connected");
        let mut tx = database.begin().await.expect("begun");
        for (sql, values) in statements {
            let query = values.iter().fold(sqlx::query(*sql), |query, value| query.bind(value.clone()));
            query.execute(&mut *tx).await.expect("inserted");
        }
        tx.commit().await.expect("kept");
        database.close().await.expect("closed");
    });
}

const DATA_SET: &str = "INSERT INTO data_set (id, path, kind, name, stamp, created_at, updated_at) \
             VALUES (1, '/nowhere', 'file', 'nowhere', '', 0, 0)";

/// Of four jobs one failed, two are done, and one is paused; each has a report.
pub fn fill(root: &Path, jobs: i64) {
    let sql = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < CAST(? AS INTEGER)) \
             INSERT INTO job (id, data_set, name, source, revision, content_key, state, options, points, bytes, error, \
               result, created_at, started_at, updated_at, finished_at) \
             SELECT i, 1, 'Tile_' || i, '/in/Tile_' || i || '.laz', 1, 'k' || i, \
               CASE i % 4 WHEN 0 THEN 'failed' WHEN 1 THEN 'paused' ELSE 'done' END, '{}', i * 977 % 9999991, i * 7919 % 99999989, \
               CASE i % 4 WHEN 0 THEN '/in/Tile_' || i || '.laz: ' || CASE i % 3 WHEN 0 THEN 'is cut: ' || (i * 7) || ' of its ' || (i * 9) || ' points could be read' WHEN 1 THEN 'is no LAS file' ELSE 'cannot be decoded' END END, \
               CASE WHEN i % 4 > 1 THEN json_object('points_in', i, 'points_out', i, 'exact', json('true'), 'projection', hex(zeroblob(1500))) END, \
               1790000000000 + i * 1000, CASE WHEN i % 4 <> 1 THEN 1790000001000 + i * 1000 END, 1790000001000, \
               CASE WHEN i % 4 <> 1 THEN 1790000001000 + i * 1000 + i * 31 % 900000 END FROM n";
    write(root, &[(DATA_SET, vec![]), (sql, vec![jobs.to_string()])]);
}

/// One job a row: name, state, points, error, report, begun and ended.
pub fn insert(root: &Path, rows: &[[String; 7]]) {
    let sql = "INSERT INTO job (data_set, name, source, revision, content_key, state, options, points, bytes, error, \
                 result, created_at, started_at, updated_at, finished_at) \
               VALUES (1, ?1, '/in/' || ?1 || '.laz', 1, ?1, ?2, '{}', CAST(?3 AS INTEGER), 7, nullif(?4, ''), nullif(?5, ''), \
                 CAST(?6 AS INTEGER), CAST(?6 AS INTEGER), 0, CAST(?7 AS INTEGER))";
    let rows = rows.iter().map(|row| (sql, row.to_vec()));
    let statements: Vec<_> = std::iter::once((DATA_SET, vec![])).chain(rows).collect();
    write(root, &statements);
}
