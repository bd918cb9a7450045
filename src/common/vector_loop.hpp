#pragma once

/// For functions that consist of loops: the compiler makes further versions, selected at run time,
/// for processors with AVX2 and with SSE4.2 (x86-64 itself has SSE2, without a rounded product of
/// 16-bit integers). They give the same values: AVX2 alone has no fused multiply-add.
/// Sanitizers instrument the selection, which runs before they are ready.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define GSV_VECTOR_LOOP __attribute__((target_clones("avx2", "sse4.2", "default")))
#else
#define GSV_VECTOR_LOOP
#endif
