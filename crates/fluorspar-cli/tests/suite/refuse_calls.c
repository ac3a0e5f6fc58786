/* Runs a program as an older kernel, a container or a sandbox would: newer system calls answer ENOSYS, and mappings that
 * ask for large or present pages EINVAL. A filter (seccomp) sees every call, also those that bypass the C library.
 *
 *     cc -o refuse_calls refuse_calls.c && ./refuse_calls PROGRAM ARGUMENT...
 *
 * Exit code 77: this system takes no filter. */
#include <errno.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <stddef.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

/* Known to the headers of this system or not. */
static const int refused[] = {
    SYS_mremap, SYS_madvise, SYS_fallocate, SYS_sched_setaffinity, SYS_sched_getaffinity, SYS_set_robust_list,
#ifdef SYS_getrandom
    SYS_getrandom,
#endif
#ifdef SYS_memfd_create
    SYS_memfd_create,
#endif
#ifdef SYS_membarrier
    SYS_membarrier,
#endif
#ifdef SYS_renameat2
    SYS_renameat2,
#endif
#ifdef SYS_copy_file_range
    SYS_copy_file_range,
#endif
#ifdef SYS_statfs
    SYS_statfs, SYS_fstatfs,
#endif
#ifdef SYS_statx
    SYS_statx,
#endif
#ifdef SYS_rseq
    SYS_rseq,
#endif
#ifdef SYS_io_uring_setup
    SYS_io_uring_setup, SYS_io_uring_enter, SYS_io_uring_register,
#endif
#ifdef SYS_clone3
    SYS_clone3,
#endif
#ifdef SYS_openat2
    SYS_openat2,
#endif
#ifdef SYS_pidfd_open
    SYS_pidfd_open, SYS_pidfd_send_signal,
#endif
#ifdef SYS_close_range
    SYS_close_range,
#endif
#ifdef SYS_faccessat2
    SYS_faccessat2,
#endif
#ifdef SYS_process_madvise
    SYS_process_madvise,
#endif
#ifdef SYS_set_mempolicy
    SYS_set_mempolicy, SYS_get_mempolicy, SYS_mbind, SYS_getcpu,
#endif
};

enum { COUNT = sizeof refused / sizeof *refused };

int main(int count, char **arguments) {
    struct sock_filter filter[COUNT + 8];
    int at = 0;
    if (count < 2) {
        fprintf(stderr, "refuse_calls: name a program\n");
        return 2;
    }
    filter[at++] = (struct sock_filter)BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr));
    for (int i = 0; i < COUNT; i++) {
        /* To the last statement, four behind the end of this list. */
        filter[at++] = (struct sock_filter)BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, refused[i], COUNT - i - 1 + 5, 0);
    }
    filter[at++] = (struct sock_filter)BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_mmap, 0, 2);
    filter[at++] = (struct sock_filter)BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, args[3]));
    filter[at++] = (struct sock_filter)BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, MAP_POPULATE | MAP_HUGETLB, 1, 0);
    filter[at++] = (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW);
    filter[at++] = (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EINVAL);
    filter[at++] = (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | ENOSYS);
    struct sock_fprog program = {.len = (unsigned short)at, .filter = filter};
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) || prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program)) {
        perror("refuse_calls");
        return 77;
    }
    execvp(arguments[1], arguments + 1);
    perror(arguments[1]);
    return 126;
}
