#include "firmware/ports/host/node_in_process.h"

#include <algorithm>

#include "firmware/testing/node_bench.h"

using armtrue::canopen::CanFrame;
using armtrue::canopen::NodeBench;

static_assert(sizeof(armtrue_frame) == 16);

struct armtrue_node {
  NodeBench bench{false};
};

armtrue_node* armtrue_node_new() { return new armtrue_node; }

void armtrue_node_free(armtrue_node* node) { delete node; }

std::uint8_t armtrue_node_id() { return NodeBench::kNodeId; }

std::size_t armtrue_node_exchange(armtrue_node* node, const armtrue_frame* request,
                                  std::uint32_t elapsed_us, armtrue_frame* sent, std::size_t room) {
  NodeBench& bench = node->bench;
  bench.now_us += elapsed_us;
  NodeBench::clock_now_us = bench.now_us;
  if (request != nullptr) {
    CanFrame frame;
    frame.id = request->identifier;
    frame.len = std::min<std::uint8_t>(request->length, sizeof request->data);
    std::copy_n(request->data, frame.len, frame.data);
    bench.upstream.deliver(frame);
  }
  bench.turn();
  std::size_t count = 0;
  for (const CanFrame& frame : bench.upstream.take_sent()) {
    if (count < room) {
      sent[count] = {frame.id, frame.len, {}, {}};
      std::copy_n(frame.data, sizeof sent[count].data, sent[count].data);
    }
    ++count;
  }
  return count;
}
