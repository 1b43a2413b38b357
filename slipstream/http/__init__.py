"""What the daemons' HTTP servers share: a bounded server on a thread of its own, problem documents,
bounded bodies, endless answers. It needs FastAPI and uvicorn, which not all daemons have.
"""
