//! Links to single octrees, for people without the token. A link names its row and
//! is signed with a key of this queue, so that none can be made up; the row says
//! that it was not revoked.

use std::io::Read;

use serde::Serialize;
use sqlx::{Row, Sqlite, Transaction};

use super::{Result, Store, StoreError, must_stand};
use crate::serve::job::{Job, JobId};

const KEY: &str = "share-key";
/// Hex digits of a signature: 160 bits.
const SIGNATURE: usize = 40;

/// A link that holds.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Share {
    pub id: i64,
    /// The octree that it opens.
    pub name: String,
    /// What stands in the link.
    pub token: String,
    /// Milliseconds since 1970.
    pub created_at: i64,
}

fn signature(key: &[u8; 32], id: i64, name: &str) -> String {
    let text = format!("share {id} {name}");
    blake3::keyed_hash(key, text.as_bytes()).to_hex()[..SIGNATURE].to_string()
}

/// Makes a link to the octree of this name.
async fn insert(
    tx: &mut Transaction<'static, Sqlite>,
    key: &[u8; 32],
    name: String,
    now: i64,
) -> Result<Share> {
    let row = sqlx::query("INSERT INTO share (name, created_at) VALUES (?, ?) RETURNING id")
        .bind(&name)
        .bind(now)
        .fetch_one(&mut **tx)
        .await?;
    let id = row.try_get("id")?;
    Ok(Share { id, token: format!("{id}-{}", signature(key, id, &name)), name, created_at: now })
}

impl Store {
    /// The key of this queue's signatures, made when it is first needed.
    async fn share_key(&self) -> Result<[u8; 32]> {
        if let Some(text) = self.setting(KEY).await?
            && let Ok(key) = blake3::Hash::from_hex(&text)
        {
            return Ok(*key.as_bytes());
        }
        let mut key = [0u8; 32];
        std::fs::File::open("/dev/urandom")
            .and_then(|mut file| file.read_exact(&mut key))
            .map_err(|error| StoreError::Query(sqlx::Error::Io(error)))?;
        // Of two that make one at the same time, the first stays.
        sqlx::query("INSERT INTO setting (key, value) VALUES (?, ?) ON CONFLICT (key) DO NOTHING")
            .bind(KEY)
            .bind(blake3::Hash::from_bytes(key).to_hex().as_str())
            .execute(&self.writer)
            .await?;
        let kept = self.setting(KEY).await?;
        Ok(kept.and_then(|text| blake3::Hash::from_hex(text).ok()).map_or(key, |hash| *hash.as_bytes()))
    }

    /// Makes a link to a job's octree, which must stand.
    pub async fn share_of(&self, job: JobId, now: i64) -> Result<Share> {
        // There is one writer: its key is made before its transaction begins.
        let key = self.share_key().await?;
        let mut tx = self.begin().await?;
        must_stand(&mut tx, job, "share").await?;
        let name: String = sqlx::query("SELECT name FROM job WHERE id = ?")
            .bind(job)
            .fetch_one(&mut *tx)
            .await?
            .try_get("name")?;
        let share = insert(&mut tx, &key, name, now).await?;
        tx.commit().await?;
        Ok(share)
    }

    /// Takes a link back; tells whether it held.
    pub async fn revoke_share(&self, id: i64, name: &str, now: i64) -> Result<bool> {
        let revoked =
            sqlx::query("UPDATE share SET revoked_at = ? WHERE id = ? AND name = ? AND revoked_at IS NULL")
                .bind(now)
                .bind(id)
                .bind(name)
                .execute(&self.writer)
                .await?;
        Ok(revoked.rows_affected() > 0)
    }

    /// The links to an octree that hold, the latest first.
    pub async fn shares(&self, name: &str) -> Result<Vec<Share>> {
        let rows = sqlx::query(
            "SELECT * FROM share WHERE name = ? AND revoked_at IS NULL ORDER BY id DESC LIMIT 100",
        )
        .bind(name)
        .fetch_all(&self.readers)
        .await?;
        if rows.is_empty() {
            return Ok(vec![]);
        }
        let key = self.share_key().await?;
        let share = |row: &sqlx::sqlite::SqliteRow| {
            let id = row.try_get("id")?;
            let token = format!("{id}-{}", signature(&key, id, name));
            Ok(Share { id, name: name.to_string(), token, created_at: row.try_get("created_at")? })
        };
        rows.iter().map(share).collect()
    }

    /// The octree that a link opens; nothing for one that was revoked or made up.
    pub async fn shared(&self, token: &str) -> Result<Option<String>> {
        let Some((id, signed)) = token.split_once('-') else { return Ok(None) };
        let Ok(id) = id.parse::<i64>() else { return Ok(None) };
        let found = sqlx::query("SELECT name FROM share WHERE id = ? AND revoked_at IS NULL")
            .bind(id)
            .fetch_optional(&self.readers)
            .await?;
        let Some(found) = found else { return Ok(None) };
        let name: String = found.try_get("name")?;
        let right = signature(&self.share_key().await?, id, &name);
        // Hashes are compared, so that the time tells nothing of the signature.
        let holds = blake3::hash(signed.as_bytes()) == blake3::hash(right.as_bytes());
        Ok(holds.then_some(name))
    }

    /// The youngest job whose octree stands under this name.
    pub async fn standing(&self, name: &str) -> Result<Option<Job>> {
        let found = sqlx::query(
            "SELECT * FROM job WHERE id = (SELECT max(id) FROM job INDEXED BY job_by_name \
             WHERE lower(name) = lower(?1) AND name = ?1 AND shown = 'done')",
        )
        .bind(name)
        .fetch_optional(&self.readers)
        .await?;
        found.as_ref().map(super::row::job).transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_link_opens_its_octree_until_it_is_revoked() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("q.db");
        let store = Store::open(&path).await.expect("opened");
        let key = store.share_key().await.expect("a key");
        let mut tx = store.begin().await.expect("begun");
        let a = insert(&mut tx, &key, "größe".to_string(), 1).await.expect("a");
        let b = insert(&mut tx, &key, "b".to_string(), 2).await.expect("b");
        tx.commit().await.expect("kept");
        let opens = |token: String| {
            let store = &store;
            async move { store.shared(&token).await.expect("asked") }
        };
        assert_eq!(opens(a.token.clone()).await.as_deref(), Some("größe"));
        assert_eq!(opens(b.token.clone()).await.as_deref(), Some("b"));
        let (_, of_a) = a.token.split_once('-').expect("a token");
        for made_up in
            [format!("{}-{of_a}", b.id), format!("{}-", a.id), "".into(), "1".into(), format!("{}x", a.token)]
        {
            assert_eq!(opens(made_up).await, None);
        }
        assert_eq!(store.shares("größe").await.expect("asked"), std::slice::from_ref(&a));
        assert!(!store.revoke_share(a.id, "b", 3).await.expect("asked"), "another's");
        assert!(store.revoke_share(a.id, "größe", 3).await.expect("revoked"));
        assert_eq!(opens(a.token.clone()).await, None);
        store.close().await;
        let store = Store::open(&path).await.expect("opened");
        assert_eq!(store.shared(&b.token).await.expect("asked").as_deref(), Some("b"), "after a restart too");
    }
}
