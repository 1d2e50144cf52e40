; What Numba's code asks of its runtime, for one module without a C library.
;
; Memory is an arena that each exported call begins by emptying. It starts where the memory ended
; at the first call, behind whatever the host has laid out by then, and grows the memory when it is
; full. Nothing is given back within a call, so that counting references is nothing at all.
; Numba's MemInfo: {i64 references, ptr, ptr, ptr data, i64 size}, 32 bytes.

target triple = "wasm32-unknown-unknown"

@arena = internal global i32 0
@free = internal global i32 0

declare i32 @llvm.wasm.memory.size.i32(i32)
declare i32 @llvm.wasm.memory.grow.i32(i32, i32)
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
declare i64 @llvm.umin.i64(i64, i64)

define void @empty() {
  %begun = load i32, ptr @arena
  %fresh = icmp eq i32 %begun, 0
  %pages = call i32 @llvm.wasm.memory.size.i32(i32 0)
  %end = shl i32 %pages, 16
  %start = select i1 %fresh, i32 %end, i32 %begun
  store i32 %start, ptr @arena
  store i32 %start, ptr @free
  ret void
}

define ptr @take(i64 %size) noinline {
  %at = load i32, ptr @free
  %from = zext i32 %at to i64
  %huge = icmp ugt i64 %size, 4294967295
  %more = add i64 %size, 31
  %whole = and i64 %more, -32
  %end = add i64 %from, %whole
  %pages = call i32 @llvm.wasm.memory.size.i32(i32 0)
  %have = zext i32 %pages to i64
  %last = add i64 %end, 65535
  %need = lshr i64 %last, 16
  %beyond = icmp ugt i64 %need, 65535
  %refused = or i1 %huge, %beyond
  br i1 %refused, label %none, label %try
try:
  %fits = icmp ule i64 %need, %have
  br i1 %fits, label %done, label %grow
grow:
  %lack = sub i64 %need, %have
  %lacking = trunc i64 %lack to i32
  %got = call i32 @llvm.wasm.memory.grow.i32(i32 0, i32 %lacking)
  %failed = icmp eq i32 %got, -1
  br i1 %failed, label %none, label %done
none:
  ret ptr null
done:
  %next = trunc i64 %end to i32
  store i32 %next, ptr @free
  %place = inttoptr i32 %at to ptr
  ret ptr %place
}

define ptr @NRT_Allocate(i64 %size) {
  %place = call ptr @take(i64 %size)
  ret ptr %place
}

define ptr @NRT_MemInfo_alloc(i64 %size) noinline {
  %all = add i64 %size, 32
  %info = call ptr @take(i64 %all)
  %none = icmp eq ptr %info, null
  br i1 %none, label %out, label %fill
fill:
  %data = getelementptr i8, ptr %info, i32 32
  %data_at = getelementptr i8, ptr %info, i32 16
  %size_at = getelementptr i8, ptr %info, i32 24
  store i64 1, ptr %info
  store ptr %data, ptr %data_at
  store i64 %size, ptr %size_at
  br label %out
out:
  ret ptr %info
}

define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %info = call ptr @NRT_MemInfo_alloc(i64 %size)
  ret ptr %info
}

define ptr @NRT_MemInfo_new_varsize(i64 %size) {
  %info = call ptr @NRT_MemInfo_alloc(i64 %size)
  ret ptr %info
}

define ptr @NRT_MemInfo_new_varsize_dtor(i64 %size, ptr %dtor) {
  %info = call ptr @NRT_MemInfo_alloc(i64 %size)
  ret ptr %info
}

define ptr @NRT_MemInfo_varsize_alloc(ptr %info, i64 %size) {
  %data = call ptr @take(i64 %size)
  %none = icmp eq ptr %data, null
  br i1 %none, label %out, label %fill
fill:
  %data_at = getelementptr i8, ptr %info, i32 16
  %size_at = getelementptr i8, ptr %info, i32 24
  store ptr %data, ptr %data_at
  store i64 %size, ptr %size_at
  br label %out
out:
  ret ptr %data
}

define ptr @NRT_MemInfo_varsize_realloc(ptr %info, i64 %size) {
  %old = call ptr @NRT_MemInfo_data_fast(ptr %info)
  %size_at = getelementptr i8, ptr %info, i32 24
  %had = load i64, ptr %size_at
  %data = call ptr @NRT_MemInfo_varsize_alloc(ptr %info, i64 %size)
  %none = icmp eq ptr %data, null
  br i1 %none, label %out, label %fill
fill:
  %both = call i64 @llvm.umin.i64(i64 %had, i64 %size)
  call void @llvm.memcpy.p0.p0.i64(ptr %data, ptr %old, i64 %both, i1 false)
  br label %out
out:
  ret ptr %data
}

define ptr @NRT_MemInfo_data_fast(ptr %info) alwaysinline {
  %data_at = getelementptr i8, ptr %info, i32 16
  %data = load ptr, ptr %data_at
  ret ptr %data
}

define void @NRT_MemInfo_varsize_free(ptr %info, ptr %data) alwaysinline {
  ret void
}

define void @NRT_Free(ptr %data) alwaysinline {
  ret void
}

define void @NRT_incref(ptr %info) alwaysinline {
  ret void
}

define void @NRT_decref(ptr %info) alwaysinline {
  ret void
}

; Strides for a new shape, of an array whose numbers lie in a row; 0 of any other.
define i32 @numba_attempt_nocopy_reshape(
    i64 %n, ptr %dims, ptr %strides, i64 %m, ptr %new_dims, ptr %new, i64 %item, i32 %order) {
  br label %old
old:
  %k = phi i64 [%n, %0], [%i, %next]
  %step = phi i64 [%item, %0], [%wider, %next]
  %end = icmp eq i64 %k, 0
  br i1 %end, label %fill, label %look
look:
  %i = sub i64 %k, 1
  %dim_at = getelementptr i64, ptr %dims, i64 %i
  %dim = load i64, ptr %dim_at
  %stride_at = getelementptr i64, ptr %strides, i64 %i
  %stride = load i64, ptr %stride_at
  %right = icmp eq i64 %stride, %step
  %one = icmp ult i64 %dim, 2
  %fine = or i1 %right, %one
  br i1 %fine, label %next, label %scattered
next:
  %wider = mul i64 %step, %dim
  br label %old
scattered:
  ret i32 0
fill:
  %total = phi i64 [%step, %old]
  br label %new_loop
new_loop:
  %q = phi i64 [%m, %fill], [%p, %put]
  %wide = phi i64 [%item, %fill], [%wide_next, %put]
  %done = icmp eq i64 %q, 0
  br i1 %done, label %compare, label %put
put:
  %p = sub i64 %q, 1
  %new_at = getelementptr i64, ptr %new, i64 %p
  store i64 %wide, ptr %new_at
  %new_dim_at = getelementptr i64, ptr %new_dims, i64 %p
  %new_dim = load i64, ptr %new_dim_at
  %wide_next = mul i64 %wide, %new_dim
  br label %new_loop
compare:
  %same = icmp eq i64 %wide, %total
  %ok = zext i1 %same to i32
  ret i32 %ok
}

; 128-bit products, with which sizes are checked; not optimised, so that it cannot become a call
; of itself.
define i128 @__multi3(i128 %a, i128 %b) optnone noinline {
  %al = trunc i128 %a to i64
  %bl = trunc i128 %b to i64
  %as = lshr i128 %a, 64
  %bs = lshr i128 %b, 64
  %ah = trunc i128 %as to i64
  %bh = trunc i128 %bs to i64
  %a0 = and i64 %al, 4294967295
  %a1 = lshr i64 %al, 32
  %b0 = and i64 %bl, 4294967295
  %b1 = lshr i64 %bl, 32
  %p00 = mul i64 %a0, %b0
  %p01 = mul i64 %a0, %b1
  %p10 = mul i64 %a1, %b0
  %p11 = mul i64 %a1, %b1
  %carry = lshr i64 %p00, 32
  %p01l = and i64 %p01, 4294967295
  %p10l = and i64 %p10, 4294967295
  %some = add i64 %carry, %p01l
  %middle = add i64 %some, %p10l
  %m = lshr i64 %middle, 32
  %p01h = lshr i64 %p01, 32
  %p10h = lshr i64 %p10, 32
  %h0 = add i64 %p11, %p01h
  %h1 = add i64 %h0, %p10h
  %h2 = add i64 %h1, %m
  %x = mul i64 %al, %bh
  %y = mul i64 %ah, %bl
  %h3 = add i64 %h2, %x
  %high = add i64 %h3, %y
  %low = mul i64 %al, %bl
  %highs = zext i64 %high to i128
  %lows = zext i64 %low to i128
  %up = shl i128 %highs, 64
  %product = or i128 %up, %lows
  ret i128 %product
}
