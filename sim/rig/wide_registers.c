// Lets Debian's User-Mode Linux run on processors with AMX (Intel's since Sapphire Rapids).
//
// UML 6.1 saves and restores the floating-point registers of the processes inside by
// ptrace(PTRACE_GETREGSET and PTRACE_SETREGSET, NT_X86_XSTATE) with a buffer of 2696 bytes, what a
// processor with AVX-512 needs. The host refuses to set less than all (EFAULT), and with AMX that
// is 11008 bytes: the first process inside dies. Preloaded before linux.uml, this puts what UML
// sets over what the host has. (UML's own mend, registers of any size, came with Linux 6.13.)
//
// Layout: Intel SDM volume 1, section 13.4, "XSAVE area".

#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

// The header's first word says which of the parts are not in their initial state.
enum { kPartsInUse = 512 };
// Parts 17 and 18 are AMX's. They lie behind UML's buffer, so the host's own word on them stands.
static const uint64_t kTiles = UINT64_C(3) << 17;

typedef long (*Ptrace)(int, pid_t, void*, void*);

// UML's stacks are small, and one thread of it does all the tracing.
static _Alignas(64) unsigned char whole[32768];

static long set_all(Ptrace host, pid_t pid, void* kind, const struct iovec* given) {
  struct iovec area = {whole, sizeof whole};
  if (host(PTRACE_GETREGSET, pid, kind, &area) != 0) return -1;
  if (given->iov_len >= area.iov_len || given->iov_len < kPartsInUse + sizeof(uint64_t))
    return host(PTRACE_SETREGSET, pid, kind, (void*)given);
  uint64_t here = 0, set = 0;
  memcpy(&here, whole + kPartsInUse, sizeof here);
  memcpy(whole, given->iov_base, given->iov_len);
  memcpy(&set, whole + kPartsInUse, sizeof set);
  set = (set & ~kTiles) | (here & kTiles);
  memcpy(whole + kPartsInUse, &set, sizeof set);
  return host(PTRACE_SETREGSET, pid, kind, &area);
}

long ptrace(enum __ptrace_request request, ...) {
  static Ptrace host = NULL;
  if (host == NULL) host = (Ptrace)dlsym(RTLD_NEXT, "ptrace");
  va_list rest;
  va_start(rest, request);
  const pid_t pid = va_arg(rest, pid_t);
  void* const address = va_arg(rest, void*);
  void* const data = va_arg(rest, void*);
  va_end(rest);
  if (request == PTRACE_SETREGSET && (uintptr_t)address == NT_X86_XSTATE)
    return set_all(host, pid, address, data);
  return host((int)request, pid, address, data);
}
