//! zencan-check CHANNEL NODE TABLES: everything a foreign client does to a compensator.
//!
//! Identity, expedited and segmented transfers and block downloads of every awkward size, a table
//! uploaded, verified, committed, put on trial and confirmed, PDO configuration, NMT. Not its block
//! upload: version 0.0.5 takes the size indicator of the server's answer for part of its sub-command. Exit status 1 with one
//! sentence at the first thing that is not as the standard says.

use std::process::ExitCode;
use std::time::Duration;

use zencan_client::{open_socketcan, BusManager, RawAbortCode, SdoClientError};

const STAGING: u16 = 0x2010;
const COMMAND: u16 = 0x2012;
const STATUS: u16 = 0x2013;

type Outcome = Result<(), String>;

fn told<E: std::fmt::Debug>(what: &str) -> impl Fn(E) -> String + '_ {
    move |problem| format!("{what}: {problem:?}")
}

fn require(condition: bool, what: &str) -> Outcome {
    condition.then_some(()).ok_or_else(|| what.to_string())
}

fn abort_code<T>(outcome: Result<T, SdoClientError>) -> Option<u32> {
    match outcome {
        Err(SdoClientError::ServerAbort { abort_code, .. }) => Some(match abort_code {
            RawAbortCode::Valid(code) => code as u32,
            RawAbortCode::Unknown(code) => code,
        }),
        _ => None,
    }
}

async fn check(channel: &str, node: u8, tables: &str) -> Outcome {
    let image = std::fs::read(tables).map_err(told(tables))?;
    let (sender, receiver) = open_socketcan(channel).map_err(told(channel))?;
    let mut bus = BusManager::new(sender, receiver);

    let found = bus.scan_nodes().await.map_err(told("scan"))?;
    require(found.iter().any(|info| info.node_id == node), "the scan did not find the node")?;
    {
        let mut client = bus.sdo_client(node);
        client.set_timeout(Duration::from_secs(5));
        let name = client.read_device_name().await.map_err(told("device name"))?;
        require(name == "Armtrue compensator", "device name")?;
        let identity = client.read_identity().await.map_err(told("identity"))?;
        require(identity.product_code == u32::from_be_bytes(*b"ARMT"), "product code")?;

        require(abort_code(client.read_u32(0x1004, 0).await) == Some(0x0602_0000), "absent object")?;
        require(abort_code(client.read_u32(0x1000, 9).await) == Some(0x0609_0011), "absent sub")?;
        require(abort_code(client.write_u32(0x1000, 0, 1).await) == Some(0x0601_0002), "read-only")?;
        require(abort_code(client.read_u32(COMMAND, 0).await) == Some(0x0601_0001), "write-only")?;
        require(abort_code(client.write_u32(0x1017, 0, 1).await) == Some(0x0607_0012), "too long")?;

        for size in [1usize, 6, 7, 8, 13, 14, 15, 888, 889, 890, 891, 4000] {
            let data: Vec<u8> = (0..size).map(|k| (k * 7 + size) as u8).collect();
            client.download(STAGING, 0, &data).await.map_err(told("segmented download"))?;
            let back = client.upload(STAGING, 0).await.map_err(told("segmented upload"))?;
            require(back == data, "segmented transfer changed the data")?;
            client.block_download(STAGING, 0, &data).await.map_err(told("block download"))?;
            let back = client.upload(STAGING, 0).await.map_err(told("segmented upload"))?;
            require(back == data, "block download changed the data")?;
        }

        client.block_download(STAGING, 0, &image).await.map_err(told("table"))?;
        for word in [b"vrfy", b"cmit", b"actv", b"cfrm"] {
            let command = u32::from_le_bytes(*word);
            let name = String::from_utf8_lossy(word).to_string();
            client.write_u32(COMMAND, 0, command).await.map_err(told(&name))?;
        }
        let active = client.upload(0x2011, 0).await.map_err(told("active table"))?;
        require(active == image, "the table in force is not the one that was sent")?;
        require(client.read_u8(STATUS, 14).await.map_err(told("trial"))? == 0, "still on trial")?;

        let pdo = client.read_rpdo_config(0).await.map_err(told("RPDO 1"))?;
        require(pdo.mappings.len() == 2, "RPDO 1 maps two targets")?;
        require(pdo.mappings[0].index == 0x607A && pdo.mappings[0].size == 32, "RPDO 1, joint 1")?;
    }
    bus.nmt_start(node).await;
    bus.nmt_reset_app(node).await;
    tokio::time::sleep(Duration::from_millis(500)).await;
    let mut client = bus.sdo_client(node);
    let active = client.upload(0x2011, 0).await.map_err(told("after the reset"))?;
    require(active == image, "a confirmed table outlives a reset")
}

#[tokio::main]
async fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, channel, node, tables] = arguments.as_slice() else {
        eprintln!("usage: zencan-check CHANNEL NODE TABLES");
        return ExitCode::from(2);
    };
    let Ok(node) = node.parse() else {
        eprintln!("zencan-check: NODE is '{node}', expected 1 to 127");
        return ExitCode::from(2);
    };
    match check(channel, node, tables).await {
        Ok(()) => ExitCode::SUCCESS,
        Err(sentence) => {
            eprintln!("zencan-check: {sentence}");
            ExitCode::from(1)
        }
    }
}
