// canopen_sizes [LAST]: transfers of every size from one byte to the largest table, segmented and
// in blocks, there and back. Exit status 1 at the first that does not come back as it was sent.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "firmware/testing/sdo_peer.h"

int main(int argc, char** argv) {
  using namespace armtrue::canopen;
  const std::size_t last =
      argc > 1 ? static_cast<std::size_t>(std::atoi(argv[1])) : armtrue::kMaxImageLength;
  const auto begin = std::chrono::steady_clock::now();
  NodeBench bench(false);
  SdoPeer peer(bench);
  for (std::size_t size = 1; size <= last; ++size) {
    try {
      peer.transfer_every_way(size);
    } catch (const std::exception& problem) {
      std::printf("%zu bytes: %s\n", size, problem.what());
      return 1;
    }
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  std::printf("sizes 1 to %zu, segmented and in blocks, there and back: as sent (%.0f s)\n", last,
              took.count());
  return 0;
}
